"""The process that holds the plugins, and composes and builds configurations for pages and queue."""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from omnilab.errors import ConfigError, DataError
from omnilab_serve.settings import ServeSettings

COMMAND = (sys.executable, "-m", "omnilab_serve.composing.worker")
LIMIT_S = 60.0  # for an answer; importing all plugins on a busy machine takes some seconds of it
MOST_KNOWN = 200  # answers
IDLE_S = 300.0  # after which nobody is expected to ask again soon
ENDING = "the service is ending, and composes nothing more"


class SettingError(ConfigError):
    """A ConfigError that knows which setting it is about, where its sentence tells."""

    def __init__(self, sentence: str, setting: str | None = None) -> None:
        super().__init__(sentence)
        self.setting = setting


class ComposerError(DataError):
    """The process died, or did not answer in time; the next request has another."""


class Composer:
    """Starts that process when it is first needed, and ends it when nobody has asked for a while. There is one at most."""

    def __init__(
        self,
        settings: ServeSettings,
        command: Sequence[str] = COMMAND,
        limit_s: float = LIMIT_S,
        idle_s: float = IDLE_S,
    ) -> None:
        self._settings, self._command, self._limit_s, self._idle_s = settings, command, limit_s, idle_s
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._rest = b""  # of what was read, behind the last answer
        self._known: dict[str, Any] = {}  # answers that are the same for as long as the process lives
        self._timer: threading.Timer | None = None
        self._stopping = False

    @property
    def pid(self) -> int | None:
        """Of the process; None while there is none."""
        return self._process.pid if self._process else None

    def catalog(self) -> Any:
        """What is installed: recipes, components, plugins that failed, launchers."""
        return self._constant("catalog")

    def form(self, experiment: str, choices: Sequence[str] = ()) -> Any:
        """The slots and settings of an experiment, with other components in some of its slots."""
        return self._constant("form", experiment=experiment, choices=list(choices))

    def check(self, overrides: Sequence[str], launcher: str) -> Any:
        """What overrides come to; SettingError in the builder's own sentence if they cannot, or must not, be run."""
        logs, inputs = str(self._settings.logs), [str(folder.absolute()) for folder in self._settings.inputs]
        given = {"overrides": list(overrides), "launcher": launcher, "logs": logs, "inputs": inputs or [os.getcwd()]}  # noqa: PTH109
        return self.ask("check", given)

    def picture(self, sensor: str, world: str) -> Path:
        """The file of a small picture, PNG, of what a sensor sees of a world."""
        return Path(self._constant("picture", name=sensor, world=world))

    def stop(self) -> None:
        """End the process, if there is one, whatever it does, for good: who waits for an answer has a ComposerError."""
        self._stopping = True
        if (process := self._process) is not None:
            process.kill()
        self.rest()

    def rest(self) -> None:
        """End the process once it has answered; the next request has another."""
        with self._lock:
            self._end()

    def ask(self, call: str, arguments: Mapping[str, Any]) -> Any:
        """An answer of the process; its refusals as SettingError, ComposerError where it came to grief."""
        with self._lock:
            answer = self._answer(json.dumps({"call": call, "arguments": arguments}).encode() + b"\n")
            self._restart_timer()
        if "refused" in answer:
            raise SettingError(answer["refused"], answer["setting"])
        if "bug" in answer:
            sys.stderr.write(answer["traceback"])
            raise ComposerError(
                f"this cannot be composed, by a mistake in a plugin or in the program itself: {answer['bug']}"
            )
        return answer["result"]

    def _constant(self, call: str, **arguments: Any) -> Any:
        key = json.dumps([call, arguments])
        if (found := self._known.get(key)) is None:
            found = self.ask(call, arguments)
            if len(self._known) >= MOST_KNOWN:
                self._known.clear()
            self._known[key] = found
        return found

    def _answer(self, line: bytes) -> dict[str, Any]:
        process = self._started()
        if self._stopping:  # after it was started, or stop() would not know of it
            self._end()
            raise ComposerError(ENDING)
        assert process.stdin is not None
        try:
            process.stdin.write(line)
            process.stdin.flush()
            found: dict[str, Any] = json.loads(self._read_line(process, time.monotonic() + self._limit_s))
        except TimeoutError:
            self._end()
            raise ComposerError(
                f"the process that composes experiments did not answer within {self._limit_s:g} s and was ended; another"
                " takes its place, so change something before you ask again"
            ) from None
        except (OSError, EOFError, ValueError) as error:
            self._end()
            if self._stopping:
                raise ComposerError(ENDING) from error
            raise ComposerError(
                f"the process that composes experiments died over this (exit status {process.returncode}); another takes its"
                " place, so change something before you ask again"
            ) from error
        return found

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is not None and self._process.poll() is not None:
            self._end()  # it died while nobody asked
        if self._process is None:
            self._process = subprocess.Popen(  # in a session of its own: Ctrl-C is for the service, which then ends it
                self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
            )
        return self._process

    def _read_line(self, process: subprocess.Popen[bytes], until: float) -> bytes:
        assert process.stdout is not None
        with selectors.DefaultSelector() as selector:  # select() alone fails with many connections
            selector.register(process.stdout, selectors.EVENT_READ)
            while b"\n" not in self._rest:
                left_s = until - time.monotonic()
                if left_s <= 0 or not selector.select(left_s):
                    raise TimeoutError
                if not (read := os.read(process.stdout.fileno(), 2**16)):
                    raise EOFError
                self._rest += read
        line, _, self._rest = self._rest.partition(b"\n")
        return line

    def _restart_timer(self) -> None:
        if self._timer:
            self._timer.cancel()
        self._timer = threading.Timer(self._idle_s, self.rest)
        self._timer.daemon = True
        self._timer.start()

    def _end(self) -> None:
        if self._timer:
            self._timer.cancel()
        process, self._process, self._rest = self._process, None, b""
        self._known.clear()
        if process is None:
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            try:
                pipe.close()
            except OSError:  # what it did not read
                continue
