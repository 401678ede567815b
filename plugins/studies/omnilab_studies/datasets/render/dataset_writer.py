"""The frames of a plan written into a data set, part by part, in this process or in several."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Generator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from omnilab.api import Camera, Disturbance, Ints, Plan, Sensor
from omnilab.errors import DataError
from omnilab_studies.common.dataset_files import DataSet, describe_camera
from omnilab_studies.common.frames import disturbed

PART = 64  # frames that are made at a time
_JOBS: list[Job] = []  # of a worker process: its one job


@dataclass(frozen=True)
class Job:
    """What turns a plan into files."""

    data: DataSet
    sensor: Sensor
    disturbances: Mapping[str, Disturbance]
    seed: int  # of the disturbances
    need_depth: bool
    again: bool  # ask the sensor for frames that are there already, too: only it knows when they were taken


@dataclass(frozen=True)
class Made:
    """A part of a plan that is on disk now."""

    first: int  # frame
    count: int  # frames of the part, with those left out
    numbers: Ints  # (n,) frames on disk
    stamps_ns: Ints | None = None  # (n,) None: the sensor was not asked
    camera: Camera | None = None
    has_depth: bool = False
    omitted: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return self.count


@dataclass
class Found:
    """What the parts of a data set told on the way."""

    recorded: bool  # the sensor knows when its images were taken
    stamps_ns: Ints  # (N,) of the plan; those of a recording are filled in
    camera: Camera | None = None
    has_depth: bool = False
    omitted: list[str] = field(default_factory=list)
    parts: list[Ints] = field(default_factory=list)

    def add(self, part: Made) -> None:
        self.parts.append(part.numbers)
        self.omitted += part.omitted
        self.camera = self.camera or part.camera
        self.has_depth |= part.has_depth
        if self.recorded and part.stamps_ns is not None:
            self.stamps_ns[part.numbers] = part.stamps_ns

    @property
    def numbers(self) -> Ints:
        """(n,) the frames that are on disk."""
        return np.concatenate(self.parts)

    def known_camera(self, plan: Plan) -> Camera:
        """The camera; DataError if the sensor delivered nothing."""
        if self.camera is None:
            raise DataError(f"the sensor delivered none of {len(plan)} images; ask for other poses")
        return self.camera

    def about(self, camera: Camera) -> dict[str, Any]:
        left_out = {"images": len(self.numbers), "not_delivered": self.omitted}
        return {**left_out, "camera": describe_camera(camera), "depth": self.has_depth}


def made(job: Job, plan: Plan, processes: int) -> Generator[Made]:
    """All parts of a plan, in order, as they come to be on disk."""
    parts = ((start, plan.at(range(start, min(start + PART, len(plan))))) for start in range(0, len(plan), PART))
    if processes == 1:
        yield from (make(job, start, part) for start, part in parts)
        return
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _begin, (job, processes))
    try:
        waiting: deque[Future[Made]] = deque()
        for start, part in parts:
            waiting.append(pool.submit(_make, start, part))
            if len(waiting) > 2 * processes:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    except BrokenProcessPool:
        raise DataError(
            f"one of {processes} processes ended before its images were whole (too little memory, or a component that"
            " only this process knows); run the same again with study.processes=1"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def make(job: Job, start: int, plan: Plan) -> Made:
    """Image and write what is missing of a part that begins at frame `start`."""
    numbers = start + np.arange(len(plan))
    there = [job.data.has(n) for n in numbers.tolist()]
    if all(there) and start > 0 and not job.again:  # the first part tells what the camera is
        return Made(start, len(plan), numbers)
    found: list[Ints] = []
    stamps: list[Ints] = []
    omitted: list[str] = []
    camera, has_depth = None, False
    for frames in job.sensor.frames(plan):
        if job.need_depth and frames.depth_m is None:
            raise DataError(
                "study.cloud_points asks for a point cloud, and the sensor tells no depth; give sensor.depth=true where"
                " it has that setting, or study.cloud_points=0"
            )
        spoilt = disturbed(frames, job.disturbances, job.seed)
        for i, n in enumerate(frames.plan_index):
            if not there[n]:
                depth = None if frames.depth_m is None else frames.depth_m[i]
                job.data.write(start + int(n), spoilt.images[i], depth)
        found.append(start + frames.plan_index)
        stamps.append(frames.stamps_ns)
        omitted += frames.omitted
        camera, has_depth = frames.camera, frames.depth_m is not None
    if camera is None:
        return Made(start, len(plan), np.array([], int), np.array([], int), omitted=omitted)
    return Made(start, len(plan), np.concatenate(found), np.concatenate(stamps), camera, has_depth, omitted)


def _begin(job: Job, processes: int) -> None:
    """Prepare a worker: its share of the processor, no Ctrl-C of its own, no life after its parent's."""
    import cv2
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends the workers, between two parts
    threading.Thread(target=_end_with_parent, daemon=True).start()
    threads = max(1, (os.cpu_count() or 1) // processes)
    os.environ["NUMBA_NUM_THREADS"] = str(threads)  # read when a renderer imports numba
    cv2.setNumThreads(threads)
    threadpool_limits(1, "blas")
    _JOBS.append(job)


def _make(start: int, plan: Plan) -> Made:
    return make(_JOBS[0], start, plan)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
