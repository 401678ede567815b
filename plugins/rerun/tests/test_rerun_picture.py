"""Pictures of a recording, taken without a display."""

from __future__ import annotations

import subprocess
import sys
from functools import cache

import numpy as np
import pytest

from omnilab.api import Image, Mesh, Panel, Text, Tick, ViewLayout
from omnilab.errors import DataError
from omnilab_rerun import RerunSink
from omnilab_rerun.binary import binary, quiet_environment
from omnilab_rerun.ports import free_port

LAYOUT = ViewLayout([[Panel("image", "Image", ["image"])], [Panel("map", "Room", ["room"])]])
FLOOR = Mesh(
    np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]),
    np.array([[0, 1, 2], [0, 2, 3]]),
    np.uint8([[0, 0, 255]] * 4),
)


@cache
def has_vulkan() -> bool:
    """Whether the viewer finds something to draw with: without, it ends at once."""
    call = [binary(), "--headless", "--bind", "127.0.0.1", "--port", str(free_port())]
    with subprocess.Popen(call, env=quiet_environment(), stderr=subprocess.DEVNULL) as viewer:
        try:
            viewer.wait(5)
        except subprocess.TimeoutExpired:
            return True
        finally:
            viewer.kill()
    return False


@pytest.fixture
def needs_vulkan():
    if not has_vulkan():
        pytest.skip("no Vulkan driver (apt-get install mesa-vulkan-drivers)")


@pytest.fixture
def run(tmp_path):
    """Two images, red at step 3 and green at step 8, a blue floor, and a log that goes on to step 9."""
    sink = RerunSink()
    sink.open(tmp_path)
    sink.write("layout", LAYOUT, None)
    sink.write("room", FLOOR, None)
    for step, color in (3, (255, 0, 0)), (8, (0, 255, 0)):
        sink.write("image", Image(np.full((40, 40, 3), color, np.uint8), "png"), Tick(step, step))
    sink.write("log", Text("end"), Tick(9, 9))
    sink.close()
    return tmp_path


def pure_pixels(picture):
    """How many pixels are nearly pure red, green and blue."""
    import cv2

    rgb = cv2.cvtColor(cv2.imread(str(picture)), cv2.COLOR_BGR2RGB).astype(int)
    others = rgb.sum(-1, keepdims=True) - rgb
    return ((rgb > 100) & (others < 60)).sum((0, 1)), rgb.shape[:2]


@pytest.mark.slow
@pytest.mark.usefixtures("needs_vulkan")
@pytest.mark.parametrize(("step", "shown"), [(None, 1), (8, 1), (5, 0)])
def test_the_picture_shows_the_step_in_the_embedded_layout(run, tmp_path, step, shown):
    RerunSink().view(run, tmp_path / "pictures" / "p.png", step=step, size=(800, 400))
    pixels, shape = pure_pixels(tmp_path / "pictures" / "p.png")
    assert shape == (400, 800)
    assert pixels[shown] > 20_000, "the image fills its half"
    assert pixels[1 - shown] < 100
    assert pixels[2] > 1000, "the floor"


@pytest.mark.slow
@pytest.mark.usefixtures("needs_vulkan")
def test_a_run_without_steps_has_a_picture_too(tmp_path):
    sink = RerunSink()
    sink.open(tmp_path)
    sink.write("layout", LAYOUT, None)
    sink.write("room", FLOOR, None)
    sink.close()
    RerunSink().view(tmp_path, tmp_path / "p.png", size=(800, 400))
    pixels, _ = pure_pixels(tmp_path / "p.png")
    assert pixels[2] > 1000


@pytest.mark.slow
def test_without_a_driver_the_package_to_install_is_named(run, tmp_path, monkeypatch):
    monkeypatch.setenv("VK_ICD_FILENAMES", "/none")
    monkeypatch.setenv("VK_DRIVER_FILES", "/none")
    with pytest.raises(DataError, match="apt-get install mesa-vulkan-drivers"):
        RerunSink().view(run, tmp_path / "p.png")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_without_a_display_the_viewer_says_what_to_do(run, monkeypatch):
    for name in "DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET":
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(DataError, match=r"DISPLAY is set.*omnilab view --screenshot FILE"):
        RerunSink().view(run)


@pytest.mark.parametrize("screenshot", [True, False])
def test_a_run_without_recording_is_reported(tmp_path, screenshot):
    with pytest.raises(DataError, match=r"run\.rrd does not exist; run the experiment with the sink rerun"):
        RerunSink().view(tmp_path, tmp_path / "p.png" if screenshot else None)


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_torn_recording_is_reported_before_the_viewer_starts(run, tmp_path):
    whole = (run / "run.rrd").read_bytes()
    (run / "run.rrd").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=r"cannot be read .*; mend it: omnilab repair"):
        RerunSink().view(run, tmp_path / "p.png")


@pytest.mark.slow
@pytest.mark.usefixtures("needs_vulkan")
def test_a_live_run_reaches_a_viewer_and_the_file(tmp_path):
    import time

    from rerun.experimental import ViewerClient

    sink = RerunSink(live=True, port=free_port())
    sink.open(tmp_path)
    sink.write("layout", LAYOUT, None)
    sink.flush()
    port = free_port()
    call = [binary(), "--headless", "--bind", "127.0.0.1", "--port", str(port), "--connect"]
    viewer = subprocess.Popen(
        [*call, f"rerun+http://127.0.0.1:{sink.port}/proxy"], env=quiet_environment(), stderr=subprocess.DEVNULL
    )
    try:
        seen = set()
        for _ in range(100):
            time.sleep(0.2)
            try:
                state = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy").get_state()
            except (RuntimeError, ConnectionError):
                continue
            seen = {recording.store_id.rpartition(":")[-1] for recording in state.recordings}
            if seen:
                break
    finally:
        viewer.kill()
        viewer.wait()
    sink.close()
    assert tmp_path.name in seen
    assert RerunSink().repair(tmp_path) is None, "the file beside the live view is complete"
