"""Rerun's viewer: a recording on the screen, or its screenshot without a display."""

from __future__ import annotations

import errno
import os
import secrets
import subprocess
import tempfile
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient

from omnilab.errors import ConfigError, DataError
from omnilab_rerun.binary import binary, complaint, quiet_environment
from omnilab_rerun.ports import LOOPBACK, free_port

START_TIMEOUT_S = 60.0
SETTLE_S = 0.5  # images are decoded over several frames
SETTLE_TRIES = 20
MOST_SPANS = 8  # of steps that are named one by one


def show(recording: Path, *parts: Path) -> None:
    """Open the viewer on a recording, be it in parts, and wait until it is closed; DataError if it does not start."""
    check_there(recording)
    call = [binary(), str(recording), *map(str, parts), "--bind", LOOPBACK, "--port", "auto"]
    ended = subprocess.run(call, env=quiet_environment(), stderr=subprocess.PIPE, text=True, check=False)
    if ended.returncode:
        raise DataError(
            f"the Rerun viewer ended with code {ended.returncode} ({complaint(ended.stderr)}); without a display take a"
            " picture instead: omnilab view --screenshot FILE.png"
        )


def take_picture(
    recording: Path, picture: Path, step: int | None, size: tuple[int, int], *parts: Path, title: str = ""
) -> None:
    """Show a step of the recording, be it in parts, in a viewer without a window, and write what is seen as a PNG.

    ConfigError for another kind of file or a step that was not logged, DataError if nothing can be read, shown or
    written; the file is written whole or not at all.
    """
    if picture.suffix.lower() != ".png":
        raise ConfigError(f"the picture {picture} would be a PNG by another name; give {picture.with_suffix('.png')}")
    check_there(recording)
    part = picture.with_name(f".{picture.name}.{os.getpid()}-{secrets.token_hex(4)}.part")  # of this process alone
    try:
        if picture.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        picture.parent.mkdir(parents=True, exist_ok=True)
        part.touch()  # found here, before the viewer has worked for nothing
    except OSError as error:
        raise DataError(f"the picture {picture} cannot be written ({error.strerror}); give another path") from error
    try:
        steps = steps_of(recording)
        if step is not None and step not in steps:
            there = f"it has {_spans(steps)}" if steps else "it has none; leave --step out"
            raise ConfigError(f"{title or recording} has no step {step}; {there}")
        part.write_bytes(_seen([recording, *parts], max(steps, default=None) if step is None else step, size))
        part.replace(picture)
    finally:
        part.unlink(missing_ok=True)


def _spans(steps: Collection[int]) -> str:
    """Numbers in few words: 0 to 4, 8."""
    ordered, found = sorted(steps), list[list[int]]()
    for step in ordered:
        if found and step == found[-1][-1] + 1:
            found[-1].append(step)
        else:
            found.append([step])
    words = [f"{span[0]} to {span[-1]}" if len(span) > 2 else ", ".join(map(str, span)) for span in found]
    if len(words) > MOST_SPANS:
        return f"{len(ordered)} steps from {ordered[0]} to {ordered[-1]}, such as {', '.join(map(str, ordered[:MOST_SPANS]))}"
    return ", ".join(words)


def steps_of(recording: Path) -> set[int]:
    """The steps at which something was logged."""
    steps = set[int]()
    try:
        for chunk in RrdReader(recording).stream().filter(has_timeline="step"):
            steps.update(chunk.to_record_batch().column("step").cast("int64").to_pylist())
    except RuntimeError as error:
        raise DataError(f"{recording} cannot be read back; mend it: omnilab repair {recording.parent}") from error
    return steps


def _seen(recordings: Sequence[Path], step: int | None, size: tuple[int, int]) -> bytes:
    """A PNG of a step. A viewer that does not answer in time gets a second try: the machine may be busy."""
    for again in (True, False):
        try:
            with _headless_viewer(recordings, size) as client:
                client.run_command("ui.toggle_top_panel")
                if step is not None:
                    client.set_time("step", sequence=step, play_state="paused")
                if seen := _settled(client, max(size)):
                    return seen
        except (RuntimeError, OSError):  # it raises either when the viewer is too slow
            if again:
                continue
        except _NoViewer as error:
            if error.useless or not again:
                raise DataError(str(error)) from error
    raise DataError("the Rerun viewer did not answer in time, twice; try again when the machine has less to do")


class _NoViewer(Exception):
    """The viewer ended or showed nothing; `useless`: it would do so again."""

    def __init__(self, why: str, useless: bool = False) -> None:
        super().__init__(why)
        self.useless = useless


def _settled(client: ViewerClient, longest: int) -> bytes:
    """A picture that the next one does not differ from."""
    last = b""
    for _ in range(SETTLE_TRIES):
        time.sleep(SETTLE_S)
        last, before = client.take_screenshot(max_size=longest), last
        if last == before:
            break
    return last


@contextmanager
def _headless_viewer(recordings: Sequence[Path], size: tuple[int, int]) -> Iterator[ViewerClient]:
    port = free_port()
    options = ["--headless", "--hide-welcome-screen", "--window-size", f"{size[0]}x{size[1]}"]
    call = [binary(), *map(str, recordings), *options, "--bind", LOOPBACK, "--port", str(port)]
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
    raise _NoViewer(f"the Rerun viewer showed nothing within {START_TIMEOUT_S:.0f} s; open the recording on a screen")


def _no_viewer(code: int, log: str) -> _NoViewer:
    if code == 102 or "adapter" in log:
        return _NoViewer(
            "the Rerun viewer found no Vulkan driver to draw with; install one, on Debian or Ubuntu:"
            " apt-get install mesa-vulkan-drivers",
            useless=True,
        )
    return _NoViewer(f"the Rerun viewer ended with code {code} ({complaint(log)}); run `rerun` by hand to see why")


def check_there(recording: Path) -> None:
    """DataError if there is no such recording."""
    if not recording.exists():
        raise DataError(f"{recording} does not exist; run the experiment with the sink rerun")
