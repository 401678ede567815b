"""From a video to a second one that is localised: the commands of docs/live.md on two drives that are rendered into files."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from omnilab.api import Bytes, Floats, PathPoses, RecordedPoses
from omnilab.cameras import save_camera
from omnilab.geometry import heading_of, planar_poses
from omnilab.runner.run_folder import load_run
from omnilab_mirror import Mirror
from omnilab_recordings import Video

pytestmark = pytest.mark.slow  # whole runs

DOCS = Path(__file__).parents[3] / "docs/live.md"
WORLD = Path(__file__).parents[2] / "box_world.yaml"
RATE = 20


def drive(count: int, aside_m: float) -> Floats:
    """Poses along a gentle curve through the room."""
    x = np.linspace(-1.2, 0.6, count)
    return planar_poses(np.column_stack([x, 0.2 * np.sin(x) + aside_m - 0.1, np.ones(count)]), 0.2 * np.cos(x))


def filmed(sensor: Mirror, T_world_camera: Floats, name: str) -> Bytes:
    """Render a drive as NAME.mkv, lossless, with its poses as NAME.csv."""
    plan = sensor.plan(PathPoses(T_world_camera))
    images = np.concatenate([frames.images for frames in sensor.frames(plan)])
    with av.open(f"{name}.mkv", "w") as container:
        stream = container.add_stream("ffv1", rate=RATE)
        stream.height, stream.width, stream.pix_fmt = *images.shape[1:], "gray"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        container.mux(stream.encode())
    rows = np.column_stack(
        [np.arange(len(images)) / RATE, T_world_camera[:, :2, 3], np.rad2deg(heading_of(T_world_camera))]
    )
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    Path(f"{name}.csv").write_text("\n".join(["stamp_s,x_m,y_m,yaw_deg", *lines]))
    return images


@pytest.fixture
def drives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Bytes]:
    """Two drives, 0.05 m apart, and the camera's calibration, in the test's folder."""
    monkeypatch.chdir(tmp_path)
    sensor = Mirror(world=str(WORLD), size=96, samples=1)
    save_camera(sensor.camera, Path("camera.json"))
    return {"first": filmed(sensor, drive(40, 0.0), "first"), "second": filmed(sensor, drive(25, 0.05), "second")}


def commands() -> list[list[str]]:
    """Those that the page shows, on the files that are there."""
    block = re.search(r"```\n(.*?)```", DOCS.read_text(), re.DOTALL)
    assert block is not None
    return [shlex.split(line.replace(".mp4", ".mkv"))[1:] for line in block[1].strip().splitlines()]


def test_a_lossless_video_is_its_rendered_twin_bit_for_bit(drives: dict[str, Bytes]) -> None:
    sensor = Video("first.mkv", camera="camera.json", positions="first.csv")
    frames = list(sensor.frames(sensor.plan(RecordedPoses())))
    assert np.array_equal(np.concatenate([batch.images for batch in frames]), drives["first"])
    T = np.concatenate([batch.T_world_camera for batch in frames if batch.T_world_camera is not None])
    assert np.allclose(T[:, :2, 3], drive(40, 0.0)[:, :2, 3], atol=1e-6)


@pytest.mark.usefixtures("drives")
def test_the_commands_of_the_page_lead_from_one_video_to_the_other(omnilab_here: Callable[..., Any]) -> None:
    calibrate, make_map, localize, view, camera = commands()
    assert (calibrate[0], view) == ("calibrate", ["view"])
    quiet = ["cache=off", "descriptor=fourier_signature"]
    assert omnilab_here(*make_map, *quiet).rc == 0
    found = Path("logs/latest").resolve()
    assert load_run(found).metrics["places"] == 40
    done = omnilab_here(*localize, "study.when_late=queue", "study.waiting=100")
    assert done.rc == 0, done.stderr
    assert "From a frame to its answer" in done.stdout + done.stderr
    paced = load_run(Path("logs/latest"))
    assert (paced.metrics["queries"], paced.metrics["dropped"]) == (25, 0)
    assert paced.metrics["position_error_median"] < 0.1
    assert {"run.mcap", "run.rrd", "latency.csv", "latency.png"} <= {
        path.name for path in Path("logs/latest").iterdir()
    }
    again = omnilab_here(*localize, "study.pace=fast", f"map={found}")
    assert again.rc == 0
    assert dict(load_run(Path("logs/latest")).metrics) == dict(paced.metrics)
    live = [text.replace("RUN", str(found)) if text.startswith("map=") else text for text in camera]
    live = [*live, "sensor.path=second.mkv", "sensor.buffer=100"]  # as if it were live
    done = omnilab_here(*live, "study.when_late=queue", "study.waiting=100")
    assert done.rc == 0, done.stderr
    assert "no errors are known" in done.stdout + done.stderr
    assert "ended after 25 of 1000 frames" in done.stdout + done.stderr
    assert load_run(Path("logs/latest")).metrics["queries"] == 25
    refused = omnilab_here("repeat", "logs/latest")
    assert refused.rc == 2
    assert "was live, as a camera or an address is" in refused.stderr
    assert "add --trust" in refused.stderr
