"""From where maps are seen, where plots of times end, and what curves are called and coloured."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import DistanceField, Panel, PlaceMap, PointCloud, Pose, Series, ViewLayout
from omnilab_rerun.blueprint import LOW, STEEP, eye
from omnilab_rerun.colors import TRUTH
from omnilab_rerun.curves import Curves
from omnilab_rerun.records_seen import RecordsSeen

TAN = np.tan(np.radians(55) / 2)  # half of what Rerun sees of a view's height, by its documentation
size = st.floats(0.1, 100)


def series(values, unit="ms", color=None):
    steps = np.arange(len(values))
    return Series(np.array(values, float), steps, steps, unit, color)


def cloud(*corners):
    return PointCloud(np.array(corners, float), np.zeros((len(corners), 3), np.uint8))


@settings(max_examples=50)
@given(size, size, st.floats(0, 100), st.floats(0.3, 6), st.sampled_from([STEEP, LOW]))
def test_a_box_fills_its_view_and_leaves_it_nowhere(wide, deep, high, aspect, back):
    box = np.array([[-wide / 2, -deep / 2, 0], [wide / 2, deep / 2, high]]) + np.array([3, -2, 1])
    shown = eye([box], aspect, back)
    position, target = (np.array(part.as_arrow_array().to_pylist()[0]) for part in (shown.position, shown.look_target))
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
    corners = np.array([[x, y, z] for x in box[:, 0] for y in box[:, 1] for z in box[:, 2]]) - position
    depth = corners @ forward
    across = np.abs(corners @ right) / depth / (TAN * aspect)
    along = np.abs(corners @ np.cross(right, forward)) / depth / TAN
    assert depth.min() > 0
    assert max(across.max(), along.max()) <= 1
    assert max(across.max(), along.max()) > 0.9 or max(wide, deep, high) < 1, "no farther than it must be"


def test_what_lies_still_is_seen_and_what_moves_about_it():
    seen = RecordsSeen()
    assert seen.corners(["room"]) is None
    assert seen.add("/room/", cloud([-4, -3, 0], [4, 3, 2]), still=True)
    assert not seen.add("room", cloud([-9, -9, 0]), still=True), "of records in one place the first counts"
    seen.add("astray", cloud([6, 0, 0], [1e6, 0, 0], [np.nan, 0, 0], [1e300, 0, 0]), still=False)
    np.testing.assert_array_equal(seen.corners(["/room"]), [[-4, -3, 0], [4, 3, 2]])
    np.testing.assert_array_equal(seen.corners(["room", "astray", "other"]), [[-4, -3, 0], [8, 3, 2]])
    np.testing.assert_array_equal(seen.corners(["astray"]), [[6, 0, 0], [1e6, 0, 0]])


def test_a_drive_is_seen_whole_and_a_map_as_it_is_at_last():
    seen = RecordsSeen()
    for x in 1.0, 5.0, 3.0:
        T = np.eye(4)
        T[:3, 3] = x, 0, 1
        seen.add("camera", Pose(T), still=False)
        seen.add("places", PlaceMap(np.array([[x, 0, 0]])), still=False)
    np.testing.assert_array_equal(seen.corners(["camera"]), [[1, 0, 1], [5, 0, 1]])
    np.testing.assert_array_equal(seen.corners(["places"]), [[3, 0, 0], [3, 0, 0]])


def test_a_field_alone_has_room_for_its_surface():
    seen = RecordsSeen()
    grid = np.stack(np.meshgrid(np.arange(11.0), np.arange(5.0), [1.0]), -1).reshape(-1, 3)
    seen.add("distances", DistanceField(grid, np.zeros(len(grid))), still=False)
    low, high = seen.corners(["distances"])
    assert (low < grid.min(0)).all()
    assert (high > grid.max(0) + np.array([0, 0, 3])).all()
    assert seen.corners(["distances", "x"])[1][2] < 2


@pytest.mark.parametrize(
    ("values", "top"),
    [
        ([9000, 20, 22, 22, *[20] * 20], (24.2, 9000)),  # a first slow image
        ([9000, 8000, np.nan, np.inf, 22, 21, *[20] * 20], (24.2, 9000)),
        ([20, 22, 21, 30, 40, *[20] * 20], None),  # nothing that flattens
        ([9000, 20, 22], None),  # too few to say what is usual
        ([0] * 20, None),
        ([], None),
    ],
)
def test_of_times_a_few_may_leave_the_plot(values, top):
    seen = RecordsSeen()
    seen.add("time/image", series(values[:3]), still=False)
    seen.add("/time/image", series(values[3:]), still=False)
    assert seen.top("time") == seen.top("/time/image/") == (top if top is None else pytest.approx(top))


def test_the_slower_of_two_curves_stays_in_the_plot_and_errors_are_not_cut():
    seen = RecordsSeen()
    seen.add("time/slow", series([100.0] * 20), still=False)
    seen.add("time/fast", series([50, *[1.0] * 20]), still=False)
    seen.add("error", series([900, *[1.0] * 20], "m"), still=False)
    assert seen.top("time") is seen.top("error") is None
    assert seen.top("time/fast") == pytest.approx((1.1, 50))


def test_a_slow_first_image_does_not_flatten_the_plot(recorded):
    layout = ViewLayout([[Panel("plot", "ms for each image", ["time/image"])], [Panel("plot", "Error", ["error"])]])
    slow = [5000, *[20.0] * 30]
    log = recorded([("", layout, None), ("time/image", series(slow), None), ("error", series(slow, "m"), None)])
    ranges = [parts["ScalarAxis:range"][-1][0] for _, parts in log.blueprint() if "ScalarAxis:range" in parts]
    np.testing.assert_allclose(ranges, [[0, 22]])
    assert log.rows("/time/image", "SeriesLines:names")[-1] == ["image, up to 5000 [ms]"]
    assert log.rows("/error", "SeriesLines:names")[-1] == ["error [m]"]


def test_curves_of_a_plot_have_colours_of_their_own_and_keep_them():
    curves = Curves()
    styles = [curves.new_style(f"rise/{name}", series([1.0], "m"), None) for name in ("a", "b", "truth", "c")]
    colors = [style["colors"][0] for style in styles]
    assert len(set(colors)) == 4
    assert colors[2] == TRUTH
    assert curves.new_style("rise/b", series([2.0], "m"), None) is None
    assert curves.new_style("rise/b", series([2.0], "m"), (1.0, 8.0)) == styles[1] | {"names": "b, up to 8 [m]"}
    assert curves.new_style("rates/a", series([1.0], "1"), None) == {"names": "a", "colors": [colors[0]]}
    assert curves.new_style("rates/b", series([1.0], "1", (1, 2, 3)), None)["colors"] == [(1, 2, 3)]
