"""Frames of a plan rendered into a data set, part by part, in this process or in several."""

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

PART = 64  # frames that are rendered at a time
_JOBS: list[RenderJob] = []  # of a worker process: its one job


@dataclass(frozen=True)
class RenderJob:
    """What turns a plan into the files of a data set."""

    data: DataSet
    sensor: Sensor
    disturbances: Mapping[str, Disturbance]
    seed: int  # of the disturbances
    need_depth: bool
    need_stamps: bool  # request existing frames from the sensor, too: only it knows when they were taken


@dataclass(frozen=True)
class RenderedPart:
    """A part of a plan that is on disk."""

    first: int  # frame
    count: int  # frames of the part, with those left out
    numbers: Ints  # (n,) frames on disk
    stamps_ns: Ints | None = None  # (n,) None: nothing was requested from the sensor
    camera: Camera | None = None
    has_depth: bool = False
    omitted: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return self.count


@dataclass
class RenderedFrames:
    """All parts of a plan so far: frames on disk, their camera, what was omitted."""

    recorded: bool  # the sensor knows when its images were taken
    stamps_ns: Ints  # (N,) of the plan; those of a recording are filled in
    camera: Camera | None = None
    has_depth: bool = False
    omitted: list[str] = field(default_factory=list)
    parts: list[Ints] = field(default_factory=list)

    def add(self, part: RenderedPart) -> None:
        """Take one part, in order."""
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
        """What `dataset.json` holds of the frames."""
        left_out = {"images": len(self.numbers), "not_delivered": self.omitted}
        return {**left_out, "camera": describe_camera(camera), "depth": self.has_depth}


def render_plan(job: RenderJob, plan: Plan, processes: int) -> Generator[RenderedPart]:
    """All parts of a plan, in order, as they come to be on disk; DataError if a process ends before its part is whole."""
    parts = ((start, plan.at(range(start, min(start + PART, len(plan))))) for start in range(0, len(plan), PART))
    if processes == 1:
        yield from (render_part(job, start, part) for start, part in parts)
        return
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _begin, (job, processes))
    try:
        waiting: deque[Future[RenderedPart]] = deque()
        for start, part in parts:
            waiting.append(pool.submit(_render_part, start, part))
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


def render_part(job: RenderJob, start: int, plan: Plan) -> RenderedPart:
    """Image and write what is missing of a part that begins at frame `start`."""
    numbers = start + np.arange(len(plan))
    exists = [job.data.has(n) for n in numbers.tolist()]
    if all(exists) and start > 0 and not job.need_stamps:  # the camera is that of the first part
        return RenderedPart(start, len(plan), numbers)
    delivered: list[Ints] = []
    stamps: list[Ints] = []
    omitted: list[str] = []
    camera, has_depth = None, False
    for frames in job.sensor.frames(plan):
        if job.need_depth and frames.depth_m is None:
            raise DataError(
                "study.cloud_points asks for a point cloud, and the sensor tells no depth; give sensor.depth=true where"
                " it has that setting, or study.cloud_points=0"
            )
        written = disturbed(frames, job.disturbances, job.seed)
        for i, n in enumerate(frames.plan_index):
            if not exists[n]:
                depth = None if frames.depth_m is None else frames.depth_m[i]
                job.data.write(start + int(n), written.images[i], depth)
            elif job.need_stamps:  # it was requested all the same
                job.data.check_same(start + int(n), written.images[i])
        delivered.append(start + frames.plan_index)
        stamps.append(frames.stamps_ns)
        omitted += frames.omitted
        camera, has_depth = frames.camera, frames.depth_m is not None
    if camera is None:
        return RenderedPart(start, len(plan), np.array([], int), np.array([], int), omitted=omitted)
    return RenderedPart(start, len(plan), np.concatenate(delivered), np.concatenate(stamps), camera, has_depth, omitted)


def _begin(job: RenderJob, processes: int) -> None:
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


def _render_part(start: int, plan: Plan) -> RenderedPart:
    return render_part(_JOBS[0], start, plan)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
