"""Large maps, searched by localizers whose answers, memory and agreement are known."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from omnilab.api import Estimates, GridPoses, Mesh, Parts, Places, RandomPoses, Signatures
from omnilab.errors import ConfigError
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import LargeMap
from omnilab_studies.localization.large_map.search_cost import array_bytes, exponent
from omnilab_studies.localization.large_map.side_by_side import GAP_M, SideBySide, in_worlds


@dataclass
class Search:
    """The most alike place."""

    asked: list[Any] = field(default_factory=list)  # how many queries at once

    def prepare(self, places, distance):
        return places, distance, distance.prepare(places.signatures)

    def locate(self, queries, index):
        self.asked.append(len(queries))
        places, distance, prepared = index
        apart = distance.match(queries, prepared).distance
        best = self.choose(apart)
        return Estimates(best, apart.min(axis=1), places.T_world_camera[best, :3, 3])

    def choose(self, apart):
        return apart.argmin(axis=1)


@dataclass
class Stubborn(Search):
    """Always the first place; its prepared map takes a known room."""

    def prepare(self, places, distance):
        return *super().prepare(places, distance), np.zeros((len(places), 1000))

    def locate(self, queries, index):
        return super().locate(queries, index[:3])

    def choose(self, apart):
        return np.zeros(len(apart), int)


@pytest.fixture
def parts(plain):
    searches = {"other": Search(), "stubborn": Stubborn()}
    return Parts(plain["Floor"](), plain["Painted"](), plain["Apart"](), Search(), localizers=searches)


@pytest.fixture
def floors(plain):
    """A sensor whose worlds differ in what they show: the name of a world is a grey level."""

    @dataclass
    class Floors(plain["Floor"]):
        world: str = "0"

        def frames(self, plan):
            for frames in super().frames(plan):
                frames.images[:, 0, 0] = int(self.world)
                yield frames

        def scene(self):
            return Mesh(np.eye(3), np.array([[0, 1, 2]]), np.full((3, 3), int(self.world), np.uint8))

    return Floors


def run(parts, **settings):
    study = LargeMap(**{"steps_m": [1.0, 0.5], "query_count": 40, **settings})
    report = study.run(parts, Recorder(), np.random.default_rng(0))
    return report, {m.name: m.value for m in report.metrics}


def test_keeps_the_contract(parts):
    check_study(LargeMap([1.0, 0.5], query_count=10), parts)


def test_agreement_and_recall_are_those_of_the_answers(parts):
    report, metrics = run(parts, query_count=400)
    assert (metrics["places_most"], metrics["maps"], metrics["queries"]) == (9 * 7, 2, 400)
    assert metrics["agreement_other"] == metrics["same_other"] == metrics["recall_exhaustive"] == 1
    truth_m = _truth_m(parts)  # the stubborn one takes all of them to be at the corner, (0, 0)
    node_m = 0.5 * np.round(2 * truth_m)  # up to the rounding of the grey levels
    at_most = lambda positions_m, limit_m: np.mean(np.linalg.norm(positions_m[:, :2], axis=1) <= limit_m)
    assert metrics["recall_stubborn"] == at_most(truth_m, 1) > 0
    assert metrics["agreement_stubborn"] == pytest.approx(at_most(node_m, 1), abs=0.02)
    assert 0 < metrics["same_stubborn"] == pytest.approx(at_most(node_m, 0), abs=0.01)
    table = report.tables["maps"]
    assert metrics["agreement_least"] == min(table["agreement"])
    assert metrics["same_least"] == min(table["same"])
    assert table["places"] == [20, 20, 20, 63, 63, 63]
    assert table["localizer"] == ["exhaustive", "other", "stubborn"] * 2


def _truth_m(parts):
    (asked, *_) = [layout for layout in parts.sensor.asked if isinstance(layout, RandomPoses)]
    return parts.sensor.plan(asked).T_world_camera[:, :3, 3]


def test_queries_come_one_at_a_time_and_are_timed(parts):
    report, _ = run(parts)
    assert set(parts.localizers["other"].asked) == {1}
    assert len(parts.localizers["other"].asked) == 2 * (1 + 40)  # a warm-up each
    table = report.tables["maps"]
    assert table["compared"] == [20] * 3 + [63] * 3
    assert all(value > 0 for name in ("query_ms", "prepare_s", "peak_mb") for value in table[name])


def test_memory_is_that_of_signatures_and_of_the_prepared_map(parts):
    table = run(parts)[0].tables["maps"]
    assert table["signatures_mb"][-1] == 63 * 16 / 1e6
    of = dict(zip(table["localizer"][3:], table["index_mb"][3:], strict=True))
    assert of == {"exhaustive": 0, "other": 0, "stubborn": 63 * 8000 / 1e6}  # two keep the signatures themselves


def test_arrays_count_once_and_views_as_the_whole(plain):
    a, b = np.zeros(100), np.zeros((50, 2), np.float32)
    assert array_bytes((a, [a, a[:3]], {"b": b.T})) == 800 + 400
    assert array_bytes([a[5:], Signatures(b), "text", None], but=Signatures(a)) == 400
    assert array_bytes(plain["Painted"]()) == 0


def test_exponents_are_slopes_of_the_logarithms(parts):
    sizes = np.array([10, 100, 5000])
    assert exponent(sizes, 3 * sizes**0.5) == pytest.approx(0.5)
    assert exponent(sizes, 0.1 * sizes) == pytest.approx(1)
    assert exponent([10, 100, 1000], [0, 5, 50]) == pytest.approx(1)
    assert np.isnan(exponent([10], [3]))
    assert np.isnan(exponent([10, 20], [0, 3]))
    growth = run(parts)[0].tables["exponents"]
    assert growth["localizer"] == ["exhaustive", "other", "stubborn"]
    assert growth["compared_exponent"] == pytest.approx([1, 1, 1])
    assert growth["index_mb_exponent"][2] == pytest.approx(1)


def test_worlds_are_added_at_the_last_step(parts, floors):
    parts = replace(parts, sensor=floors())
    report, metrics = run(parts, worlds=["7", "9"])
    table = report.tables["maps"]
    assert table["places"][::3] == [20, 63, 126, 189]
    assert table["worlds"][::3] == [1, 1, 2, 3]
    assert table["step_m"][::3] == [1.0, 0.5, 0.5, 0.5]
    assert metrics["recall_exhaustive"] < 1  # to this descriptor the floors look alike


def test_worlds_lie_side_by_side(floors):
    sensors = in_worlds(floors(), ["7", "9"])
    both = SideBySide.of(sensors, GridPoses(0.5))
    plan = both.plan(GridPoses(0.5))
    x = plan.T_world_camera[:, 0, 3].reshape(3, 63)
    np.testing.assert_allclose(x.min(axis=1), [0, 4 + GAP_M, 2 * (4 + GAP_M)])
    some = plan.at([0, 70, 120, 188])
    frames = list(both.frames(some))
    assert np.concatenate([f.images[:, 0, 0] for f in frames]).tolist() == [0, 7, 7, 9]
    assert np.concatenate([f.plan_index for f in frames]).tolist() == [0, 1, 2, 3]
    np.testing.assert_array_equal(np.concatenate([f.T_world_camera for f in frames]), some.T_world_camera)
    alone = next(iter(sensors[1].frames(sensors[1].plan(GridPoses(0.5)).at([7]))))
    np.testing.assert_array_equal(frames[1].images[0, 1:], alone.images[0, 1:])
    asked = both.plan(RandomPoses(10, 3)).T_world_camera[:, 0, 3]
    assert np.histogram(asked, [0, 5, 11, 17])[0].tolist() == [3, 3, 4]
    assert both.first(2).plan(GridPoses(0.5)).keys == plan.keys[:126]
    places = Places(Signatures(np.arange(189.0)), plan.T_world_camera, plan.keys)
    assert both.first(2).part_of(places).signatures.place.tolist() == list(range(126))
    mesh = both.scene()
    np.testing.assert_allclose(mesh.vertices_m[3:6], np.eye(3) + np.array([4 + GAP_M, 0, 0]))
    assert mesh.triangles.tolist() == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]


def test_disturbances_spoil_the_queries_and_never_the_places(parts):
    class Black:
        def apply(self, images, camera, rngs):
            return np.zeros_like(images)

    _, metrics = run(replace(parts, disturbances={"black": Black()}))
    assert metrics["same_stubborn"] == 1  # all are taken to be at the corner that is painted black


def test_settings_that_make_no_sense_are_refused(parts):
    with pytest.raises(ConfigError, match=r"steps_m=\[\] holds 0 numbers; give 1 or more"):
        LargeMap([])
    with pytest.raises(ConfigError, match=r"steps_m=\[0.5, 0\] holds 0, which is out of range"):
        LargeMap([0.5, 0])
    with pytest.raises(ConfigError, match="query_count=0"):
        LargeMap(query_count=0)
    with pytest.raises(ConfigError, match="query_count=2 leaves worlds without a query; give 3 or more"):
        LargeMap(worlds=["a", "b"], query_count=2)
    with pytest.raises(ConfigError, match="Floor images the world it has"):
        run(parts, worlds=["office"])
    with pytest.raises(ConfigError, match="choose another name"):
        run(replace(parts, localizers={"exhaustive": Search()}))
