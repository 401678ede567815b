"""A queue whose submissions run a program of the tests instead of omnilab."""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path

from omnilab.client import SubmissionRequest
from omnilab.errors import ConfigError
from omnilab_serve.composing import Composed, Composer
from omnilab_serve.events import Events
from omnilab_serve.queue import RunQueue, children, run_queue
from omnilab_serve.settings import ServeSettings

HERE = Path(__file__).parent
PATIENCE_S = 60  # on a machine that does much else


def composed(request: SubmissionRequest, _: Composer) -> Composed:
    """As a composer would, and it refuses `refused=on`."""
    if "refused=on" in request.overrides:
        raise ConfigError("refused=on cannot be")
    sweep = any("," in word for word in request.overrides)
    words = [*(["-m"] if sweep else []), *request.overrides]
    return Composed(request.overrides[0].partition("=")[2], 2 if sweep else 1, words)


def patched() -> None:
    """From now on submissions run the program of the tests."""
    children.PROGRAM = (sys.executable, str(HERE / "fake_omnilab.py"))  # type: ignore[assignment]
    run_queue.check_request = composed  # type: ignore[attr-defined]


def queue_of(logs: Path, workers: int = 1) -> RunQueue:
    """One that is not started."""
    logs.mkdir(parents=True, exist_ok=True)
    patched()
    settings = ServeSettings(logs, workers=workers)
    return RunQueue(settings, Events(), Composer(settings))


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def until(is_so: Callable[[], object], patience_s: float = PATIENCE_S) -> None:
    """Wait; the test fails if it does not come to be."""
    end_s = time.monotonic() + patience_s
    while not is_so():
        assert time.monotonic() < end_s
        time.sleep(0.02)
