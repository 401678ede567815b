"""Data that no method can be judged by: equal and black pictures, maps of one place, queries out of the map itself."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from omnilab.api import Circle, Estimates, Frames, GridPoses, Match, Metric, Parts, Places, Plan, Signatures
from omnilab.cameras import ImageCircle
from omnilab.errors import DataError
from omnilab.geometry import planar_poses
from omnilab.metrics import equal, first_alike
from omnilab.runner.recorder import Recorder
from omnilab_studies import Grid, LargeMap, Linearity
from omnilab_studies.common.methods import Method
from omnilab_studies.common.scores import Degeneracy, score
from omnilab_studies.common.tables import markdown, markdown_table
from omnilab_studies.local_maps.candidates import describe_images
from omnilab_studies.localization.grid.study import Queries
from omnilab_studies.localization.map.study import MapStudy

CAMERA = ImageCircle(8, 8, Circle(3.5, 3.5, 4))
FOUR = np.array([[0.0, 0, 1], [1, 0, 1], [2, 0, 1], [3, 0, 1]])  # m
BETWEEN = np.array([[0.1, 0, 1], [1.2, 0, 1], [2.9, 0, 1]])


@dataclass
class Album:
    """Pictures of one grey level each, at places and between them."""

    places: list[int] = field(default_factory=lambda: [10, 20, 30, 40])  # grey levels
    queries: list[int] = field(default_factory=lambda: [11, 22, 39])
    places_m: np.ndarray = field(default_factory=lambda: FOUR)
    queries_m: np.ndarray = field(default_factory=lambda: BETWEEN)

    def plan(self, layout):
        name, at = ("p", self.places_m) if isinstance(layout, GridPoses) else ("q", self.queries_m)
        return Plan([f"{name}{i}" for i in range(len(at))], planar_poses(at))

    def frames(self, plan):
        levels = [getattr(self, {"p": "places", "q": "queries"}[key[0]])[int(key[1:])] for key in plan.keys]
        images = np.broadcast_to(np.array(levels, np.uint8)[:, None, None], (len(levels), 8, 8))
        index = np.arange(len(levels))
        yield Frames(images, plan.keys, index, CAMERA, index, plan.T_world_camera)

    def scene(self):
        return None


@dataclass
class Level:
    """The grey level."""

    view, color, rotation, default_distance = "mirror", False, "none", "apart"

    def describe(self, images):
        return Signatures(images[:, :1, 0].astype(np.float32))


@dataclass
class Apart:
    """The difference of the levels; a rotation of 0."""

    def prepare(self, places):
        return places.place

    def match(self, queries, index):
        apart = np.abs(queries.place - index.T)
        return Match(apart, np.zeros_like(apart))


@dataclass
class Nearest:
    """The first of the most alike places."""

    field: bool = True

    def prepare(self, places, distance):
        return places, distance, distance.prepare(places.signatures)

    def locate(self, queries, index):
        places, distance, prepared = index
        match = distance.match(queries, prepared)
        best = match.distance.argmin(axis=1)
        position_m = places.T_world_camera[best, :3, 3]
        every = match.distance if self.field else None
        return Estimates(best, match.distance.min(axis=1), position_m, np.zeros(len(best)), every)


def run(album, **changed):
    """Metrics and warnings of the grid study."""
    parts = {"sensor": album, "descriptor": Level(), "distance": Apart(), "localizer": Nearest()} | changed
    record = Recorder()
    study = Grid(step_m=None, every=1, queries=Queries.rest)
    report = study.run(Parts(**parts), record, np.random.default_rng(1))
    return {metric.name: metric for metric in report.metrics}, list(record.warnings), report.tables["queries"]


def test_sound_data_is_not_warned_of():
    metrics, warnings, _ = run(Album())
    assert warnings == []
    for name in ("nearest_rate", "recall_at_1", "average_precision", "recall_at_full_precision", "within_step_rate"):
        assert metrics[name].value == 1
    assert metrics["heading_error_mean"].value == 0


@pytest.mark.parametrize("level", [0, 128])
def test_equal_pictures_win_nothing(level):
    metrics, warnings, table = run(Album([level] * 4, [level] * 3))
    for name in ("nearest_rate", "within_step_rate", "recall_at_1", "average_precision", "recall_at_full_precision"):
        assert metrics[name].value == 0, name
    assert metrics["wrong_rate"].value == 1
    assert np.isnan(metrics["heading_error_median"].value)
    assert metrics["heading_error_median"].note == "nothing tells any answer from other places"
    assert np.isnan(table["heading_error_deg"]).all()
    assert max(table["rank"]) == 4
    assert [warning.partition(",")[0] for warning in warnings] == [
        "all 4 places of the map have equal signatures", "all 3 queries have equal signatures"
    ]  # fmt: skip


def test_equal_distances_but_for_rounding_win_nothing():
    @dataclass
    class Rounded(Apart):
        """The same distance to all, nearly."""

        def match(self, queries, index):
            found = super().match(queries, index)
            return replace(found, distance=(1 + 1e-8 * found.distance.astype(float)))

    metrics, warnings, _ = run(Album(), distance=Rounded())
    assert metrics["nearest_rate"].value == 0
    (warning,) = warnings
    assert warning.startswith("3 of 3 queries have answers that nothing tells from places elsewhere: each counts as")


def test_copies_of_a_picture_count_as_the_worse_and_are_told():
    metrics, warnings, table = run(
        Album([10, 20, 30, 10])
    )  # 0 and 3 look alike; the first query is near 0, the last near 3
    assert table["verdict"] == ["wrong", "nearest", "second"]
    without, _, _ = run(Album([10, 20, 30, 10]), localizer=Nearest(field=False))
    assert without["nearest_rate"].value == metrics["nearest_rate"].value
    assert metrics["nearest_rate"].value == pytest.approx(1 / 3)
    assert metrics["recall_at_1"].value == pytest.approx(2 / 3)  # place 2 is within a step of the last
    assert np.isnan(table["heading_error_deg"]).tolist() == [True, False, False]
    assert metrics["heading_error_mean"].value == 0  # of those that are decided
    assert warnings[0].startswith("1 of 4 places of the map have the signature of one before")
    assert "(the first: p0 and p3)" in warnings[0]
    assert warnings[1].startswith("1 of 3 queries have answers that nothing tells from places elsewhere")


def test_a_query_half_way_between_two_different_places_is_no_mistake():
    metrics, warnings, _ = run(Album(queries=[15, 25, 39]))
    assert metrics["nearest_rate"].value == 1
    assert warnings == []


def test_queries_out_of_the_map_itself_are_told():
    metrics, warnings, _ = run(Album(queries=[10, 20, 40], queries_m=FOUR[[0, 1, 3]]))
    assert metrics["recall_at_1"].value == 1
    (warning,) = warnings
    assert warning.startswith("3 of 3 queries have exactly the signature of the place that answers them")


def test_one_answer_for_all_queries_is_told():
    _, warnings, _ = run(Album(queries=[11, 11, 11]))
    assert warnings == [
        "all 3 queries have equal signatures, as black or constant pictures have: they get one answer"
    ]  # fmt: skip


@pytest.mark.parametrize(
    "places_m", [FOUR[:1], FOUR[[1, 1, 1, 1]], FOUR[[1, 1]] + [[0, 0, 0], [1e-13, 0, 0]], FOUR * [2e-4, 1, 1]]
)
def test_a_map_of_one_place_is_refused(places_m):
    count = len(places_m)
    with pytest.raises(
        DataError, match=rf"all places of the map \({count}\) are at one position.*every answer would be"
    ):
        run(Album([10, 20, 30, 40][:count], places_m=places_m))


def test_places_with_several_pictures_have_the_spacing_of_their_positions():
    metrics, _, _ = run(Album([10, 10, 20, 20], places_m=FOUR[[0, 0, 1, 1]], queries=[11], queries_m=BETWEEN[:1]))
    assert metrics["position_error_steps_median"].value == pytest.approx(0.1)
    assert metrics["nearest_rate"].value == 1  # both copies are there


def test_a_rate_that_had_nothing_to_decide_is_empty():
    metrics, _, _ = run(Album([10, 20], [15], FOUR[:2], np.array([[0.4, 0, 1]])))  # both places are within a step
    for name in ("recall_at_1", "recall_at_1_percent", "average_precision", "recall_at_full_precision"):
        assert np.isnan(metrics[name].value), name
        assert metrics[name].note == "every place of the map is within one step of every query"
    metrics, _, _ = run(Album(queries_m=np.add(BETWEEN, [0, 9, 0])))
    assert np.isnan(metrics["average_precision"].value)
    assert np.isnan(metrics["recall_at_full_precision"].value)
    assert metrics["recall_at_1"].note == "no query has a place of the map within one step"
    assert metrics["queries_without_place"].value == 3


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_verdicts_do_not_depend_on_the_unit_of_the_map(scale):
    """Half-way but for a millionth of a step: either place is nearest, on a table as in a town."""
    at = np.array([[0.500001, 0, 0], [1.45, 0, 0]]) * scale
    places_m = FOUR * [1, 1, 0] * scale
    index = np.arange(2)
    frames = Frames(np.zeros((2, 8, 8), np.uint8), ["a", "b"], index, CAMERA, index, planar_poses(at))
    estimates = Estimates(np.array([0, 2]), np.zeros(2), places_m[[0, 2]])
    assert score(frames, estimates, places_m, scale).verdict.tolist() == ["nearest", "second"]


def test_a_map_of_equal_pictures_is_told_when_it_is_made():
    record = Recorder()
    parts = Parts(sensor=Album([7] * 4), descriptor=Level(), distance=Apart())
    report = MapStudy(step_m=1.0).run(parts, record, np.random.default_rng(1))
    assert [warning[:36] for warning in record.warnings] == ["all 4 places of the map have equal s"]
    assert report.metrics[-1].name == "step"


def test_studies_that_compare_images_tell_of_equal_ones():
    sensor, record = Album([7, 8, 7, 9]), Recorder()
    methods = [Method("level", "level", Level(), Apart(), "apart")]
    describe_images(methods, sensor.frames(sensor.plan(GridPoses(1.0))), 4, "images", record)
    (warning,) = record.warnings
    assert warning.startswith(
        "level: 1 of 4 images have the signature of one before, as copies of a picture or black ones"
    )
    assert "(the first: p0 and p2)" in warning


@pytest.mark.parametrize("study", [LargeMap([1.0], query_count=3), Linearity(every=1, step_m=1.0, reach_m=3.0)])
def test_no_study_is_silent_on_black_pictures(study):
    record = Recorder()
    parts = Parts(
        sensor=Album([0] * 4, [0] * 4, queries_m=FOUR), descriptor=Level(), distance=Apart(), localizer=Nearest(),
        descriptors={"level": Level()}, default_distances={"level": Apart()}, localizers={"nearest": Nearest()},
    )  # fmt: skip
    study.run(parts, record, np.random.default_rng(1))
    assert any("have equal signatures" in warning for warning in record.warnings)


def test_the_viewer_shows_why_there_is_no_value():
    metrics = [Metric("error_mean", float("nan"), "m", note="no answer"), Metric("rate", 0.5, "1")]
    assert markdown_table(metrics, "T").splitlines()[-2:] == ["| error mean | – no answer |", "| rate | 0.5  |"]
    assert "nan" not in markdown({"a": [float("nan"), 1.0]})


def test_equal_signatures():
    place = np.arange(600, dtype=np.float32).reshape(2, 3, 100)
    same = place.copy()
    same[1, 2, 77] += 1  # which the sample leaves out
    assert equal(Signatures(place), Signatures(same)).tolist() == [True, False]
    heading = np.array([[1.0], [2.0]], np.float32)
    assert equal(Signatures(place, heading), Signatures(place, heading[::-1])).tolist() == [False, False]
    assert first_alike(Signatures(np.concatenate([place, same]))).tolist() == [0, 1, 0, 3]
    assert Degeneracy(Places(Signatures(place[:1]), None, ["a"])).map_warnings() == []
