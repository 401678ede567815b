"""Live localisation in a map of 1000 places, 20 frames a second on one core: latency and memory; and reading a video.

OMP_NUM_THREADS=1 taskset -c 0 pytest tests/benchmarks/live --benchmark-enable -n 0 -s -m slow
"""

from __future__ import annotations

import resource
import time
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from omnilab.api import Frames, Parts, PathPoses, Plan, RecordedPoses
from omnilab.geometry import planar_poses
from omnilab.runner.recorder import Recorder
from omnilab_appearance import Cityblock, FourierSignature, Nearest, PocBand, Radon
from omnilab_mirror import Mirror
from omnilab_recordings import Video
from omnilab_studies import LiveLocalize
from omnilab_studies.common.describing import describe, describe_places
from omnilab_studies.common.live.pacing import ReplayPace
from omnilab_studies.common.localization_run import LocalizationRun

pytestmark = pytest.mark.slow
PLACES, FRAMES, RATE = 1000, 200, 20


class Drive:
    """Frames that are there already, 20 a second."""

    def __init__(self, frames: Frames) -> None:
        self._frames = frames

    def plan(self, _):
        return Plan(list(self._frames.keys), self._frames.T_world_camera)

    def frames(self, _):
        yield from (self._frames.at(i) for i in range(len(self._frames)))

    def scene(self):
        return None


@pytest.fixture(scope="module")
def drive():
    """Places on a grid of the room, and a drive of 10 s through it."""
    sensor = Mirror(size=250, samples=1)
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-3, -0.2, 40), np.linspace(-1.8, 1.0, 25)))
    places = sensor.plan(PathPoses(planar_poses(np.column_stack([x, y, np.ones(PLACES)]))))
    along = np.linspace(-2.8, -0.4, FRAMES)
    plan = sensor.plan(PathPoses(planar_poses(np.column_stack([along, 0.3 * along, np.ones(FRAMES)]))))
    found = list(sensor.frames(plan))
    frames = Frames(
        np.concatenate([f.images for f in found]), plan.keys, np.arange(FRAMES) * (10**9 // RATE), found[0].camera,
        np.arange(FRAMES), plan.T_world_camera,
    )  # fmt: skip
    return sensor, places, Drive(frames)


@pytest.mark.benchmark(group="live localisation, 1000 places, 20 frames a second")
@pytest.mark.parametrize("descriptor", [Radon(), FourierSignature()], ids=["radon", "fourier_signature"])
def test_bench_live(benchmark, drive, descriptor):
    sensor, plan, frames = drive
    distance = PocBand() if isinstance(descriptor, Radon) else Cityblock()
    described = {"descriptor": descriptor, "distance": distance}
    places, _ = describe_places(Parts(sensor=sensor, **described), plan, Recorder())
    parts = Parts(sensor=frames, localizer=Nearest(), map=places, **described)

    def live():
        return LiveLocalize(pace=ReplayPace.recorded, show=0).run(parts, Recorder(), np.random.default_rng(0))

    why = "no other program localises by these descriptors; they and the search stand beside their peers"
    benchmark.extra_info.update(count=FRAMES, unit="a frame", no_peer=why)
    report = benchmark.pedantic(live, rounds=1)
    run, each = LocalizationRun(parts, places, Recorder(), 0), list(frames.frames(None))
    begin_s = time.process_time()
    for frame in each:
        run.locate(describe(descriptor, frame, run.record))
    each_ms = 1e3 * (time.process_time() - begin_s) / FRAMES
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(  # noqa: T201
        f"\n{report.summary.splitlines()[-1]} Processor: {each_ms:.1f} ms a frame. Memory: {peak_mb:.0f} MB."
    )


@pytest.fixture
def video(tmp_path: Path) -> str:
    rng = np.random.default_rng(0)
    wide = rng.integers(0, 256, (1000, 1200), dtype=np.uint8)
    with av.open(str(tmp_path / "a.mp4"), "w") as container:
        stream = container.add_stream(
            "libx264", rate=RATE, options={"preset": "veryfast", "x264-params": "log-level=none"}
        )
        stream.height, stream.width, stream.pix_fmt = 1000, 1000, "yuv420p"
        for i in range(FRAMES):
            image = np.ascontiguousarray(wide[:, i : i + 1000])
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")))
        container.mux(stream.encode())
    return str(tmp_path / "a.mp4")


@pytest.mark.benchmark(group="videos: 200 frames of 1000 x 1000, H.264")
@pytest.mark.parametrize("every", [1, 20])
def test_bench_video(benchmark, video, every):
    def read():
        sensor = Video(video, circle_px=[499.5, 499.5, 490], every=every)
        return sum(len(frames) for frames in sensor.frames(sensor.plan(RecordedPoses())))

    benchmark.extra_info.update(
        what=f"`video`, one in {every}" if every > 1 else "`video`", count=FRAMES, unit="a frame"
    )
    assert benchmark.pedantic(read, rounds=2) == FRAMES // every


@pytest.mark.benchmark(group="videos: 200 frames of 1000 x 1000, H.264")
def test_bench_video_by_opencv(benchmark, video):
    def read():
        capture = cv2.VideoCapture(video)
        return sum(1 for _ in iter(lambda: capture.read()[0], False))

    benchmark.extra_info.update(peer="`cv2.VideoCapture`, in colour", count=FRAMES)
    assert benchmark.pedantic(read, rounds=2) == FRAMES
