"""Frames one by one, as fast as they can be processed or at the pace at which they were recorded, and when each was done."""

from __future__ import annotations

import contextvars
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, Frames, Parts, Plan, Recorder, Sensor, Series, Text, Tick
from omnilab_studies.common.frames import deliver_queries, disturbed

DEPENDS = (
    "study.pace=recorded: frames come at the pace of their times, and those that come while {waiting} are dropped; which ones,"
    " and so every number of this run, depends on how busy the machine is (study.pace=fast gives the same each time)"
)


class ReplayPace(Enum):
    """When the frames of a recording come."""

    fast = "fast"  # each as soon as the one before is done: the same results each time
    recorded = "recorded"  # at their own times: as from the robot


class WhenLate(Enum):
    """What becomes of frames that come while others are not done."""

    queue = "queue"  # they wait, and the oldest of too many is dropped
    drop = "drop"  # the newest waits, all others are dropped


class ArrivedFrame(NamedTuple):
    """A frame, as a batch of one, and when it was there, by `time.perf_counter`."""

    frame: Frames
    since_s: float


@dataclass
class Latencies:
    """When frames came, when work on each began and when it was done."""

    steps: list[int] = field(default_factory=list)
    waited_ms: list[float] = field(default_factory=list)
    worked_ms: list[float] = field(default_factory=list)

    @property
    def latency_ms(self) -> Floats:
        """From when a frame is there to when its answer is (N,)."""
        return np.add(self.waited_ms, self.worked_ms)

    def add(self, record: Recorder, tick: Tick, since_s: float, begun_s: float) -> None:
        """A frame is done now."""
        now = time.perf_counter()
        self.steps.append(tick.step)
        self.waited_ms.append(1e3 * max(begun_s - since_s, 0.0))
        self.worked_ms.append(1e3 * (now - begun_s))
        if len(self.steps) > 1:  # the first dwarfs all others
            value = np.array([self.waited_ms[-1] + self.worked_ms[-1]])
            record.log("time/latency_ms", Series(value, np.array([tick.step]), np.array([tick.stamp_ns]), "ms"))

    def table(self) -> dict[str, list[float]]:
        """A row per frame."""
        return {
            "frame": [float(step) for step in self.steps],
            "waited_ms": self.waited_ms,
            "worked_ms": self.worked_ms,
            "latency_ms": self.latency_ms.tolist(),
        }

    def in_words(self, dropped: int) -> str:
        """Percentiles, and how many frames were dropped: Markdown."""
        if len(self.steps) < 2:
            return f"Frames dropped: {dropped}."
        first, *_ = later = self.latency_ms
        median, most, rare = np.percentile(later[1:], [50, 95, 99])
        return (
            f"From a frame to its answer: {median:.1f} ms median, {most:.1f} ms at 95 %, {rare:.1f} ms at 99 %,"
            f" {later[1:].max():.1f} ms at most, of {len(later) - 1} frames; work on one: {np.median(self.worked_ms[1:]):.1f} ms (median)."
            f" The first one, with which all is loaded, took {first:.0f} ms. Frames dropped: {dropped}."
        )


@dataclass
class PacedFrames:
    """The frames of a plan, one by one. Frames that a sensor could not deliver are in `omitted`, others that were late in
    `dropped`."""

    pace: ReplayPace
    when_late: WhenLate
    waiting: int  # at most, with WhenLate.queue
    omitted: list[str] = field(default_factory=list)
    dropped: list[int] = field(default_factory=list)  # of the plan
    latencies: Latencies = field(default_factory=Latencies)

    @contextmanager
    def answering(self, arrived: ArrivedFrame, record: Recorder) -> Iterator[None]:
        """Within it a frame is worked on, until its answer is there."""
        begun_s = time.perf_counter()
        yield
        tick = Tick(int(arrived.frame.plan_index[0]), int(arrived.frame.stamps_ns[0]))
        self.latencies.add(record, tick, arrived.since_s, begun_s)

    def in_words(self) -> str:
        """Latencies, and how many frames were dropped."""
        return self.latencies.in_words(len(self.dropped))

    def tables(self) -> dict[str, dict[str, list[float]]]:
        """`latency.csv` of a run at its own pace."""
        return {"latency": self.latencies.table()} if self.pace is ReplayPace.recorded else {}

    def log(self, record: Recorder) -> None:
        """The same, onto the terminal and into the logs, of a run at its own pace."""
        if self.pace is ReplayPace.recorded:
            record.log("log", Text(self.in_words(), "NOTE"))

    def of(self, parts: Parts, plan: Plan, record: Recorder, seed: int) -> Iterator[ArrivedFrame]:
        """Each frame as it comes, disturbed by the run's disturbances."""
        if self.pace is ReplayPace.fast:
            for frames in deliver_queries(parts, plan, record, seed):
                self.omitted += frames.omitted
                for i in range(len(frames)):
                    yield ArrivedFrame(frames.at(i), time.perf_counter())
            return
        most = self.waiting if self.when_late is WhenLate.queue else 1
        waiting = f"{most} others wait" if most > 1 else "another waits"
        record.log("log", Text(DEPENDS.format(waiting=waiting), "NOTE"))
        queue = _ArrivalQueue(most)
        context, live = contextvars.copy_context(), bool(getattr(parts.sensor, "live", False))
        replay = (_replay, one_at_a_time(parts.sensor).frames(plan), queue, live)
        threading.Thread(target=context.run, args=replay, name="omnilab-replay", daemon=True).start()
        try:
            for frame, since_s in record.track(queue.arrivals(), "queries", len(plan), lambda _: 1):
                yield ArrivedFrame(disturbed(frame, parts.disturbances, seed) if parts.disturbances else frame, since_s)
        finally:
            queue.stop()
            self.omitted += queue.omitted
            self.dropped += queue.dropped


def one_at_a_time(sensor: Sensor) -> Sensor:
    """The sensor, handing over each frame as soon as it has it, where it has a setting for that."""
    if "batch" not in getattr(sensor, "__dataclass_fields__", ()):
        return sensor
    alone: Sensor = replace(sensor, batch=1)  # type: ignore[type-var]
    return alone


class _ArrivalQueue:
    """What has come and is not processed yet, between the thread that replays and the one that works."""

    def __init__(self, most: int) -> None:
        self._most, self._held = most, deque[ArrivedFrame]()
        self._turn = threading.Condition()
        self._error: BaseException | None = None
        self.ended = self.ready = False  # to go on: what is loaded with the first frame is
        self.omitted: list[str] = []
        self.dropped: list[int] = []

    def put(self, frame: Frames, since_s: float) -> None:
        with self._turn:
            self._held.append(ArrivedFrame(frame, since_s))
            if len(self._held) > self._most:
                self.dropped.append(int(self._held.popleft().frame.plan_index[0]))
            self._turn.notify()

    def wait_until_ready(self) -> None:
        """Until the first frame is done, or the end."""
        with self._turn:
            self._turn.wait_for(lambda: self.ready or self.ended)

    def wait_until(self, due_s: float) -> None:
        """Until then, or the end."""
        with self._turn:
            self._turn.wait_for(lambda: self.ended, max(due_s - time.perf_counter(), 0.0))

    def stop(self, error: BaseException | None = None) -> None:
        with self._turn:
            self.ended, self._error = True, error
            self._turn.notify_all()

    def arrivals(self) -> Iterator[ArrivedFrame]:
        while True:
            with self._turn:
                self._turn.wait_for(lambda: self._held or self.ended)
                if not self._held:
                    break
                arrival = self._held.popleft()
            yield arrival
            with self._turn:
                self.ready = True
                self._turn.notify_all()
        if self._error is not None:
            raise self._error


def _replay(source: Iterator[Frames], queue: _ArrivalQueue, live: bool) -> None:
    """Put each frame into the queue when its time has come, counted from when the first was done; of a live sensor at once."""
    clock_s: float | None = None  # when it is 0 by the frames' times
    try:
        for frames in source:
            queue.omitted += frames.omitted
            for i, stamp_ns in enumerate(frames.stamps_ns.tolist()):
                due_s = time.perf_counter() if clock_s is None else clock_s + stamp_ns / 1e9
                queue.wait_until(due_s)
                if queue.ended:
                    return
                queue.put(frames.at(i), due_s)
                if not live and clock_s is None:
                    queue.wait_until_ready()
                    clock_s = time.perf_counter() - stamp_ns / 1e9
    except BaseException as error:  # noqa: BLE001  it belongs to the thread that works
        queue.stop(error)
    else:
        queue.stop()
