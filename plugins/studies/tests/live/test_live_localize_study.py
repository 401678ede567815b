"""Frames localised as they come: the same answers as all at once, paced by their own times, late ones dropped or queued."""

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from omnilab.api import Estimates, GridPoses, Parts, Plan, RecordedPoses, Series
from omnilab.errors import DataError
from omnilab.geometry import planar_poses
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies.common.describing import describe_places
from omnilab_studies.common.live.pacing import Latencies, ReplayPace, WhenLate
from omnilab_studies.common.plots import blank_figure
from omnilab_studies.common.pose_sources import Source
from omnilab_studies.localization.live_localize.study import LiveLocalize
from omnilab_studies.localization.localize.study import Localize

STEP_NS = 10_000_000  # between frames


@dataclass
class Replayed:
    """Some positions on the conftest's floor, recorded one after another; `torn` is a frame that cannot be read."""

    floor: Any
    known: bool = True
    count: int = 12
    torn: int | None = None
    fails_at: int | None = None
    batch: int = 5

    def plan(self, layout):
        assert layout == RecordedPoses()
        T = planar_poses(
            np.column_stack([np.linspace(0.2, 3.8, self.count), np.full(self.count, 1.3), np.ones(self.count)])
        )
        return Plan([str(i) for i in range(self.count)], T if self.known else None)

    def frames(self, plan):
        true = replace(self, known=True).plan(RecordedPoses())
        for frames in self.floor(unread=[] if self.torn is None else [self.torn]).frames(true):
            if self.fails_at in frames.plan_index:
                raise DataError("the cable is out; plug it in")
            T = frames.T_world_camera if self.known else None
            yield replace(frames, stamps_ns=frames.plan_index * STEP_NS, T_world_camera=T)

    def scene(self):
        return None


@dataclass
class Slow:
    """A localizer that takes its time."""

    localizer: object
    seconds: float = 0.03

    def prepare(self, places, distance):
        return self.localizer.prepare(places, distance)

    def locate(self, queries, index):
        time.sleep(self.seconds)
        return self.localizer.locate(queries, index)


@dataclass
class Nearest:
    """The place whose signature is nearest."""

    def prepare(self, places, distance):
        return places, distance, distance.prepare(places.signatures)

    def locate(self, queries, index):
        places, distance, prepared = index
        field = distance.match(queries, prepared).distance
        best = field.argmin(1)
        return Estimates(best, field.min(1), places.T_world_camera[best, :3, 3], np.zeros(len(best)), field)


class Shown(Recorder):
    """Keeps what is logged, by path."""

    def __init__(self):
        super().__init__()
        self.logged = {}

    def log(self, path, record, tick=None):
        self.logged.setdefault(path, []).append(record)


@pytest.fixture
def parts(plain):
    described = {"descriptor": plain["Painted"](), "distance": plain["Apart"]()}
    floor = plain["Floor"]()
    places, _ = describe_places(Parts(sensor=floor, **described), floor.plan(GridPoses(step_m=0.5)), Recorder())

    def make(seconds=0.0, **settings):
        localizer = Slow(Nearest(), seconds) if seconds else Nearest()
        return Parts(sensor=Replayed(plain["Floor"], **settings), localizer=localizer, map=places, **described)

    return make


@pytest.fixture(autouse=True)
def quick_figures(request, monkeypatch):
    """Figures are drawn by one test alone."""
    if request.function is test_keeps_the_contract:
        return
    where = "omnilab_studies.localization.live_localize.live_run"
    monkeypatch.setattr(f"{where}.localization_figures", lambda *_: {"recall": blank_figure(1, 1)})
    monkeypatch.setattr(f"{where}.latency", lambda *_: blank_figure(1, 1))


def run(study, parts):
    record = Shown()
    return study.run(parts, record, np.random.default_rng(0)), record


def metrics(report):
    return {metric.name: metric.value for metric in report.metrics}


def test_keeps_the_contract(parts):
    check_study(LiveLocalize(), parts())


def test_answers_are_those_of_localising_all_at_once(parts):
    live, _ = run(LiveLocalize(), parts())
    at_once, _ = run(Localize(queries=Source.recorded), parts())
    assert live.tables["queries"] == at_once.tables["queries"]
    assert metrics(live) == metrics(at_once) | {"dropped": 0}


def test_at_its_own_pace_a_fast_machine_gives_the_same_answers(parts):
    fast, _ = run(LiveLocalize(), parts())
    begin = time.perf_counter()
    paced, record = run(LiveLocalize(pace=ReplayPace.recorded, waiting=100), parts())
    assert time.perf_counter() - begin >= 11 * STEP_NS / 1e9 - 0.001
    assert metrics(paced) == metrics(fast)
    assert paced.tables["queries"] == fast.tables["queries"]
    assert "depends on how busy the machine is" in record.logged["log"][0].text


@pytest.mark.parametrize(("when_late", "waiting"), [(WhenLate.drop, 20), (WhenLate.queue, 2)])
def test_late_frames_are_dropped_and_counted(parts, when_late, waiting):
    study = LiveLocalize(pace=ReplayPace.recorded, when_late=when_late, waiting=waiting)
    report, record = run(study, parts(seconds=0.05, count=25))
    found = metrics(report)
    assert found["dropped"] > 0
    assert found["queries"] + found["dropped"] == 25
    assert report.tables["queries"]["query"][-1] == 24  # the newest always gets its turn
    answered = report.tables["queries"]["query"]
    assert answered == sorted(answered)
    assert f"Frames dropped: {found['dropped']:.0f}." in report.summary
    latencies = np.array(report.tables["latency"]["latency_ms"])
    assert np.all(latencies >= np.array(report.tables["latency"]["worked_ms"]))
    assert all(isinstance(one, Series) for one in record.logged["time/latency_ms"])


def test_a_queue_that_is_long_enough_drops_none_and_makes_later_frames_wait(parts):
    report, _ = run(LiveLocalize(pace=ReplayPace.recorded, waiting=100), parts(seconds=0.03))
    assert metrics(report)["dropped"] == 0
    waited = report.tables["latency"]["waited_ms"]
    assert waited[-1] > waited[2] + 60  # ten more frames of 30 ms each, every 10 ms


def test_without_truth_there_are_answers_and_a_word_on_it(parts):
    report, record = run(LiveLocalize(), parts(known=False))
    assert len(report.tables["answers"]["place"]) == 12
    assert set(metrics(report)) == {"queries", "distance_median", "places", "dropped"}
    assert any("no errors are known" in text.text for text in record.logged["log"])
    assert len(record.logged["answer"]) == 12


@pytest.mark.parametrize("pace", [ReplayPace.fast, ReplayPace.recorded])
def test_frames_that_cannot_be_read_are_left_out_with_their_reason(parts, pace):
    report, _ = run(LiveLocalize(pace=pace, waiting=100), parts(torn=3))
    assert list(report.omitted) == ["3: torn"]
    assert metrics(report)["queries"] == 11
    assert metrics(report)["left_out"] == 1


def test_what_goes_wrong_while_it_is_replayed_ends_the_run(parts):
    with pytest.raises(DataError, match="the cable is out"):
        run(LiveLocalize(pace=ReplayPace.recorded), parts(fails_at=7))


def test_latencies_in_words_leave_the_first_frame_out():
    latencies = Latencies([0, 1, 2], [0.0, 5.0, 1.0], [900.0, 10.0, 20.0])
    said = latencies.in_words(3)
    assert "18.0 ms median" in said
    assert "took 900 ms. Frames dropped: 3." in said
