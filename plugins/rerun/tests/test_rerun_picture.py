"""Pictures of a recording, taken without a display."""

from __future__ import annotations

import subprocess
import sys
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from omnilab.api import Image, Mesh, Panel, Text, Tick, ViewLayout
from omnilab.errors import ConfigError, DataError
from omnilab_rerun import RerunSink
from omnilab_rerun import viewer as viewer_module
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
@pytest.mark.parametrize(("step", "shown"), [(None, 1), (8, 1), (3, 0)])
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
    with pytest.raises(DataError, match=r"cannot be read back; mend it: omnilab repair"):
        RerunSink().view(run, tmp_path / "p.png")


# ------------------------------------------------------------------------------------------- what is refused
PNG = b"\x89PNG made up"


@pytest.fixture
def viewer(monkeypatch):
    """`viewer(*answers)`: what each viewer that is started answers, an error or a picture. Calls: the steps shown."""
    shown = []

    def made_up(*answers):
        left = list(answers)

        class Client:
            def run_command(self, _):
                pass

            def set_time(self, _, sequence, play_state):
                assert play_state == "paused"
                shown.append(sequence)

            def take_screenshot(self, max_size):
                if isinstance(left[0], bytes):
                    return left[0]
                raise left.pop(0)

        @contextmanager
        def started(recording, size):
            if isinstance(left[0], viewer_module._NoViewer):
                raise left.pop(0)
            yield Client()

        monkeypatch.setattr(viewer_module, "_headless_viewer", started)
        monkeypatch.setattr(viewer_module, "SETTLE_S", 0)
        return shown

    return made_up


@pytest.mark.parametrize("step", [999, -1, 5, 0, 10])
def test_a_step_that_was_not_logged_is_refused(run, tmp_path, viewer, step):
    shown = viewer(PNG)
    with pytest.raises(ConfigError, match=rf"run\.rrd has no step {step}; it has 3, 8, 9$"):
        RerunSink().view(run, tmp_path / "p.png", step=step)
    assert shown == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.rrd"]


@pytest.mark.parametrize(("step", "expected"), [(None, 9), (3, 3), (8, 8)])
def test_the_step_that_is_named_is_shown(run, tmp_path, viewer, step, expected):
    shown = viewer(PNG)
    RerunSink().view(run, tmp_path / "p.png", step=step)
    assert shown == [expected]
    assert (tmp_path / "p.png").read_bytes() == PNG


def test_a_recording_without_steps_says_so(tmp_path, viewer):
    sink = RerunSink()
    sink.open(tmp_path)
    sink.write("room", FLOOR, None)
    sink.close()
    viewer(PNG)
    with pytest.raises(ConfigError, match="has no step 1; it has none; leave --step out"):
        RerunSink().view(tmp_path, tmp_path / "p.png", step=1)
    RerunSink().view(tmp_path, tmp_path / "p.png")


@pytest.mark.parametrize(
    ("steps", "words"),
    [(range(5), "0 to 4"), ([0, 1, 5, 6, 7], "0, 1, 5 to 7"), ([7], "7"), (range(0, 40, 2), "20 steps from 0 to 38, such as 0, 2, 4, 6, 8, 10, 12, 14")],
)  # fmt: skip
def test_steps_in_few_words(steps, words):
    assert viewer_module._spans(set(steps)) == words


@pytest.mark.parametrize("name", ["p.jpg", "p", "p.pdf", "p.png.gif"])
def test_another_kind_of_picture_is_refused_and_the_advice_works(run, tmp_path, viewer, name):
    viewer(PNG)
    with pytest.raises(ConfigError, match=r"would be a PNG by another name; give (\S+\.png)$") as refused:
        RerunSink().view(run, tmp_path / name)
    assert not (tmp_path / name).exists()
    advised = Path(str(refused.value).rpartition("give ")[2])
    RerunSink().view(run, advised)
    assert advised.read_bytes() == PNG


@pytest.mark.parametrize("first", [RuntimeError("timeout"), ConnectionError(), TimeoutError(), viewer_module._NoViewer("it showed nothing")], ids=repr)  # fmt: skip
def test_a_slow_viewer_gets_a_second_try(run, tmp_path, viewer, first):
    viewer(first, PNG)
    RerunSink().view(run, tmp_path / "p.png")
    assert (tmp_path / "p.png").read_bytes() == PNG


@pytest.mark.parametrize(
    ("answers", "told"),
    [
        ([RuntimeError("a"), RuntimeError("b")], "did not answer in time, twice"),
        ([viewer_module._NoViewer("it showed nothing")] * 2, "it showed nothing"),
        ([viewer_module._NoViewer("no driver", useless=True)], "no driver"),
    ],
    ids=["silent", "slow", "no driver"],
)
def test_a_viewer_that_fails_leaves_the_picture_of_before(run, tmp_path, viewer, answers, told):
    for before in (None, b"before"):
        if before is not None:
            (tmp_path / "p.png").write_bytes(before)
        viewer(*answers)
        with pytest.raises(DataError, match=told):
            RerunSink().view(run, tmp_path / "p.png")
        assert (tmp_path / "p.png").exists() == (before is not None)
        assert not list(tmp_path.glob(".*"))
    assert (tmp_path / "p.png").read_bytes() == b"before"


@pytest.mark.parametrize("path", ["folder.png", "file/p.png"])
def test_a_picture_that_cannot_be_written_is_named(run, tmp_path, viewer, path):
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").write_text("in the way")
    viewer(PNG)
    with pytest.raises(DataError, match=r"the picture .* cannot be written \(.*\); give another path"):
        RerunSink().view(run, tmp_path / path)


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
    assert any(name.startswith(f"{tmp_path.name}-") for name in seen)
    assert RerunSink().repair(tmp_path) is None, "the file beside the live view is complete"
