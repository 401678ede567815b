"""Reading a recorded set, beside OpenCV alone in a loop."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.api import RecordedPoses
from omnilab_recordings import Folder

COUNT = 48


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    for i in range(COUNT):
        noise = rng.integers(0, 256, (1000, 1000), dtype=np.uint8)
        cv2.imwrite(str(tmp_path / f"{i}.jpg"), cv2.GaussianBlur(noise, (7, 7), 2))
    return tmp_path


@pytest.mark.benchmark(group="recordings: read 48 JPEG files of 1000 x 1000")
def test_bench_folder(benchmark, recording):
    def read():
        sensor = Folder(str(recording), circle_px=[499.5, 499.5, 490])
        return sum(len(frames) for frames in sensor.frames(sensor.plan(RecordedPoses())))

    benchmark.extra_info.update(what="`folder`", count=COUNT, unit="an image")
    assert benchmark.pedantic(read, rounds=3) == COUNT


@pytest.mark.benchmark(group="recordings: read 48 JPEG files of 1000 x 1000")
def test_bench_opencv_alone(benchmark, recording):
    def read():
        benchmark.extra_info.update(peer="`cv2.imread`", count=COUNT)
        return len([cv2.imread(str(recording / f"{i}.jpg"), cv2.IMREAD_GRAYSCALE) for i in range(COUNT)])

    assert benchmark.pedantic(read, rounds=3) == COUNT
