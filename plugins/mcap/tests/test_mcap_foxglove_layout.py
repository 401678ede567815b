"""The layout for Foxglove: of the form of exported ones, and bound to what the log holds."""

import json
import math

import numpy as np
import pytest

from omnilab import api
from omnilab.errors import ConfigError
from omnilab_mcap import McapSink

PANELS = (("map", "Room", ["room", "places", "/camera", "distances", "cloud", "sites"]), ("image", "Query", ["camera/image"]),
          ("image", "Signature", ["camera/signature"]), ("plot", "Error", ["/error"]), ("text", "Result", ["summary"]),
          ("log", "Log", ["log"]), ("image", "Never logged", ["nothing"]))  # fmt: skip
TAKEN = {  # by panel, from Foxglove's documentation: what it shows
    "3D": {"SceneUpdate", "PointCloud", "PosesInFrame", "PoseInFrame"},
    "Image": {"CompressedImage", "RawImage"},
    "RosOut": {"Log"},
}


@pytest.fixture
def layout_of(tmp_path, read):
    """A function: the layout file of these records shown in these columns (None: none was written), and the log's topics."""

    def layout_of(records, columns, widths=()):
        sink = McapSink()
        sink.open(tmp_path)
        sink.write(
            "layout", api.ViewLayout([[api.Panel(*panel) for panel in column] for column in columns], widths), None
        )
        for path, record in records:
            sink.write(path, record, api.Tick(3, 5))
        sink.close()
        file = tmp_path / "foxglove_layout.json"
        return json.loads(file.read_text()) if file.exists() else None, read(tmp_path / "run.mcap")

    return layout_of


def leaves(tree):
    """The panels of a mosaic, left to right and down; fails if it is no tree of splits."""
    if isinstance(tree, str):
        return [tree]
    assert set(tree) == {"first", "second", "direction", "splitPercentage"}
    assert tree["direction"] in {"row", "column"}
    assert 0 < tree["splitPercentage"] < 100
    return leaves(tree["first"]) + leaves(tree["second"])


def topics_of(name, panel):
    match name.split("!")[0]:
        case "3D":
            return list(panel["topics"])
        case "Image":
            return [panel["imageMode"]["imageTopic"]]
        case "Plot":
            return [path["value"].removesuffix(".value") for path in panel["paths"]]
        case "RosOut":
            return [panel["topicToRender"]]


@pytest.fixture
def everything(layout_of, records):
    others = [(path, record) for path, record in records.items() if not isinstance(record, api.ViewLayout)]
    return layout_of([*others, ("summary", api.Text("# Good", markdown=True))], [PANELS[:3], PANELS[3:]])


def test_has_the_form_of_exported_layouts(everything):
    layout, _ = everything
    assert set(layout) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    names = leaves(layout["layout"])
    assert sorted(names) == sorted(layout["configById"])
    assert [name.split("!")[0] for name in names] == ["3D", "Image", "Image", "Plot", "RosOut", "RosOut"]
    assert "Never logged" not in [panel["foxglovePanelTitle"] for panel in layout["configById"].values()]


def test_each_topic_is_in_the_log_with_a_schema_that_its_panel_shows(everything):
    layout, topics = everything
    for name, panel in layout["configById"].items():
        assert topics_of(name, panel)
        for topic in topics_of(name, panel):
            kind, schema = name.split("!")[0], topics[topic][0].schema.name
            if kind == "Plot":
                assert isinstance(topics[topic][0].decoded.value, float)
            else:
                assert schema.removeprefix("foxglove.") in TAKEN[kind]


def test_a_path_shows_what_lies_below_it_and_not_what_begins_alike(layout_of):
    curve = api.Series(np.ones(2), np.arange(2), np.arange(2), "m")
    layout, _ = layout_of([("error/x", curve), ("errors", curve)], [[("plot", "Error", ["error"])]])
    assert topics_of("Plot!", layout["configById"][layout["layout"]]) == ["/error/x"]


def test_shares_of_columns_and_panels(layout_of):
    text = [(str(number), api.Text("a")) for number in range(4)]
    panel = [("log", str(number), [str(number)]) for number in range(4)]
    layout, _ = layout_of(text, [panel[:1], panel[1:3], panel[3:]], (3, 2, 1))
    tree = layout["layout"]
    assert (tree["direction"], tree["splitPercentage"]) == ("row", 50)
    assert (tree["second"]["direction"], tree["second"]["splitPercentage"]) == ("row", pytest.approx(66.67))
    assert (tree["second"]["first"]["direction"], tree["second"]["first"]["splitPercentage"]) == ("column", 50)


def test_the_eye_sees_the_whole_scene(layout_of):
    corners = np.array([[2.0, 1, 0], [12, 7, 0], [2, 7, 3], [12, 1, 3]])
    layout, _ = layout_of([("places", api.PlaceMap(corners))], [[("map", "Places", ["places"])]])
    panel = layout["configById"][layout["layout"]]
    eye = panel["cameraState"]
    assert panel["followTf"] == "world"
    phi, half = math.radians(eye["phi"]), math.radians(eye["fovy"] / 2)
    target = np.array(eye["targetOffset"])
    np.testing.assert_allclose(target, [7, 4, 1.5])
    position = target + eye["distance"] * np.array([0, -math.sin(phi), math.cos(phi)])
    forward = (target - position) / eye["distance"]
    to_corner = corners - position
    angles = np.arccos(to_corner @ forward / np.linalg.norm(to_corner, axis=1))
    assert angles.max() < half
    assert eye["near"] < np.linalg.norm(to_corner, axis=1).min()
    assert np.linalg.norm(to_corner, axis=1).max() < eye["far"]


@pytest.mark.parametrize(("steps", "axis"), [([3, 5], "custom"), ([3, 6], "timestamp")])
def test_curves_of_the_same_steps_are_plotted_over_them(layout_of, steps, axis):
    records = [
        ("curve/a", api.Series(np.ones(1), np.array([3]), np.array([0]), "m", (255, 0, 16))),
        ("curve/a", api.Series(np.ones(1), np.array([5]), np.array([1]), "m", (255, 0, 16))),
        ("curve/b", api.Series(np.ones(2), np.array(steps), np.arange(2), "m")),
    ]
    layout, _ = layout_of(records, [[("plot", "Curves", ["curve"])]])
    panel = layout["configById"][layout["layout"]]
    assert panel["xAxisVal"] == axis
    assert [path["label"] for path in panel["paths"]] == ["a [m]", "b [m]"]
    assert panel["paths"][0]["color"] == "#ff0010"


def test_a_signature_is_shown_between_its_least_and_greatest_value(layout_of):
    signatures = [api.Signature(np.full((2, 2), value, np.float32)) for value in (-2.0, 7.0)]
    layout, _ = layout_of([("signature", each) for each in signatures], [[("image", "Signature", ["signature"])]])
    mode = layout["configById"][layout["layout"]]["imageMode"]
    assert (mode["minValue"], mode["maxValue"]) == (-2, 7)


def test_nothing_to_show_leaves_no_file(layout_of):
    assert layout_of([], [PANELS])[0] is None


def test_unknown_kind_of_panel(layout_of):
    with pytest.raises(ConfigError, match="kind 'table'; give one of map, image, plot, text, log"):
        layout_of([], [[("table", "Table", ["rows"])]])
