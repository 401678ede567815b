"""Rerun's viewer: a recording on the screen, or its screenshot without a display."""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient

from omnilab.errors import DataError
from omnilab_rerun.binary import binary, complaint, quiet_environment
from omnilab_rerun.ports import LOOPBACK, free_port

START_TIMEOUT_S = 60.0
SETTLE_S = 0.5  # images are decoded over several frames
SETTLE_TRIES = 20


def show(recording: Path) -> None:
    """Open the viewer and wait until it is closed; DataError if it does not start."""
    _exists(recording)
    call = [binary(), str(recording), "--bind", LOOPBACK, "--port", "auto"]
    ended = subprocess.run(call, env=quiet_environment(), stderr=subprocess.PIPE, text=True, check=False)
    if ended.returncode:
        raise DataError(
            f"the Rerun viewer ended with code {ended.returncode} ({complaint(ended.stderr)}); without a display take a"
            " picture instead: omnilab view --screenshot FILE"
        )


def take_picture(recording: Path, picture: Path, step: int | None, size: tuple[int, int]) -> None:
    """Show a step of the recording in a viewer without a window, and write what is seen as a PNG."""
    _exists(recording)
    try:
        picture.parent.mkdir(parents=True, exist_ok=True)
        picture.touch()
    except OSError as error:
        raise DataError(f"the picture {picture} cannot be written ({error.strerror}); give another path") from error
    step = last_step_with_image(recording) if step is None else step
    with _headless_viewer(recording, size) as client:
        client.run_command("ui.toggle_top_panel")
        if step is not None:
            client.set_time("step", sequence=step, play_state="paused")
        picture.write_bytes(_settled(client, max(size)))


def _settled(client: ViewerClient, longest: int) -> bytes:
    """A picture that the next one does not differ from."""
    last = b""
    for _ in range(SETTLE_TRIES):
        time.sleep(SETTLE_S)
        last, before = client.take_screenshot(max_size=longest), last
        if last == before:
            break
    return last


def last_step_with_image(recording: Path) -> int | None:
    """The last step at which an image was logged, if any was."""
    try:
        chunks = RrdReader(recording).stream().filter(has_timeline="step", components="EncodedImage:blob").to_chunks()
    except RuntimeError as error:
        raise DataError(f"{recording} cannot be read ({error}); mend it: omnilab repair {recording.parent}") from error
    steps = (max(chunk.to_record_batch().column("step").to_pylist()) for chunk in chunks)
    return max(steps, default=None)


@contextmanager
def _headless_viewer(recording: Path, size: tuple[int, int]) -> Iterator[ViewerClient]:
    port = free_port()
    options = ["--headless", "--hide-welcome-screen", "--window-size", f"{size[0]}x{size[1]}"]
    call = [binary(), str(recording), *options, "--bind", LOOPBACK, "--port", str(port)]
    with tempfile.TemporaryFile("w+") as log:
        # what it logs below an error it also shows on top of the picture
        viewer = subprocess.Popen(call, env=quiet_environment() | {"RUST_LOG": "error"}, stdout=log, stderr=log)
        try:
            yield _connected(viewer, port, log)
        finally:
            viewer.kill()
            viewer.wait()


def _connected(viewer: subprocess.Popen[bytes], port: int, log: IO[str]) -> ViewerClient:
    """A client of the viewer, once that has loaded the recording and laid out its views."""
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline:
        if viewer.poll() is not None:
            log.seek(0)
            raise _no_viewer(viewer.returncode, log.read())
        try:
            client = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
            state = client.get_state()
        except (RuntimeError, ConnectionError):
            time.sleep(0.1)  # it does not listen yet
            continue
        if state.views and not state.loading:
            return client
        time.sleep(0.1)
    raise DataError(f"the Rerun viewer showed nothing within {START_TIMEOUT_S:.0f} s; open the recording on a screen")


def _no_viewer(code: int, log: str) -> DataError:
    if code == 102 or "adapter" in log:
        return DataError(
            "the Rerun viewer found no Vulkan driver to draw with; install one, on Debian or Ubuntu:"
            " apt-get install mesa-vulkan-drivers"
        )
    return DataError(f"the Rerun viewer ended with code {code} ({complaint(log)}); run `rerun` by hand to see why")


def _exists(recording: Path) -> None:
    if not recording.exists():
        raise DataError(f"{recording} does not exist; run the experiment with the sink rerun")
