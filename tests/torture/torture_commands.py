"""Commands of omnilab in processes forked from this one, which has imported all that they need, and what disturbs them."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import io
import os
import pickle
import resource
import select
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
PATIENCE_S = 300.0  # for one command, on a busy machine
ACTIONS = ("nothing", "kill", "signal", "fail", "fail once")  # as in faults.c
PLAN = struct.Struct("5q1024s1024s")


@dataclass(frozen=True)
class Fault:
    """What befalls the command at its `at`-th operation on files below its folder: of `ACTIONS`, with a number (errno, signal).

    `torn`: a write does half of its work first. `fail` goes on from there. `below`: only operations in this subfolder.
    """

    action: str
    at: int
    number: int = 0
    torn: bool = False
    below: str = ""


@dataclass(frozen=True)
class Operation:
    """One operation on a file, as faults.c noted it."""

    time_ns: int
    name: str
    path: str


@dataclass(frozen=True)
class Ended:
    """What a command left. `code` is negative where a signal ended it."""

    code: int
    stdout: str
    stderr: str
    operations: Sequence[Operation] = ()

    @property
    def said(self) -> str:
        """For a report."""
        return f"exit code {self.code}\n{self.stdout[-1500:]}\n{self.stderr[-3000:]}"


class Skipped(Exception):
    """A case cannot be made on this machine; the reason."""


def why_not() -> str:
    """Why commands cannot be disturbed on this machine; "" where they can."""
    if not sys.platform.startswith("linux"):
        return "operations on files are counted on Linux only"
    return "" if shutil.which("cc") else "there is no C compiler (cc) for faults.c"


def preload() -> None:
    """Start this very program again, with faults.c loaded before the C library."""
    if "TORTURE_LIBRARY" in os.environ:
        return
    library = Path(tempfile.mkdtemp(prefix="torture-")) / "faults.so"
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", library, HERE / "faults.c", "-ldl"], check=True)
    loaded = {"LD_PRELOAD": str(library), "TORTURE_LIBRARY": str(library), "PYTHONDONTWRITEBYTECODE": ""}
    os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | loaded)


class Command:
    """A command that runs: `omnilab *argv` in a folder. Its output is read as far as given, then its pipe is closed."""

    def __init__(
        self,
        folder: Path,
        *argv: str,
        fault: Fault | None = None,
        env: Mapping[str, str] | None = None,
        reads: tuple[float, float] = (float("inf"), float("inf")),  # bytes of stdout, stderr
        before: Callable[[], Any] = lambda: None,  # in the new process
    ) -> None:
        self.folder = folder
        self._plan = Path(tempfile.mkdtemp(prefix="plan-", dir=folder.parent))
        self._plan_of(fault)
        self._texts = {1: b"", 2: b""}
        self._left = {1: reads[0], 2: reads[1]}
        pipes = {number: os.pipe() for number in (1, 2)}
        self.pid = os.fork()
        if self.pid == 0:
            _become(folder, argv, pipes, {"TORTURE_PLAN": str(self._plan / "plan"), **(env or {})}, before)
        self._ends = {number: read for number, (read, _) in pipes.items()}
        for _, write in pipes.values():
            os.close(write)
        self.code: int | None = None
        self._close_those_read()

    def _plan_of(self, fault: Fault | None) -> None:
        action = ACTIONS.index(fault.action) if fault else 0
        numbers = (fault.at, action, fault.number, int(fault.torn)) if fault else (0, 0, 0, 0)
        watched = str(self.folder.resolve() / (fault.below if fault else "")).encode()
        log = str(self._plan / "operations").encode()
        (self._plan / "plan").write_bytes(PLAN.pack(0, *numbers, watched, log))

    def send(self, number: int, group: bool = False) -> int:
        """Send a signal to the process, or to all of its group; the time, ns."""
        now = time.time_ns()
        with contextlib.suppress(ProcessLookupError):
            (os.killpg if group else os.kill)(self.pid, number)
        return now

    def runs(self, seconds: float) -> bool:
        """Whether it still runs after so long."""
        end = time.monotonic() + seconds
        while self.code is None and (left := end - time.monotonic()) > 0:
            self._take(min(left, 0.1))
        return self.code is None

    def wait(self) -> Ended:
        """Its end; of a command that does not end, after it was killed."""
        if self.runs(PATIENCE_S):
            self.send(signal.SIGKILL, group=True)
            self.runs(10)
            self._texts[2] += b"\nTraceback: it did not end by itself"
        for end in self._ends.values():
            os.close(end)
        texts = (text.decode(errors="replace") for text in self._texts.values())
        assert self.code is not None
        operations = _operations(self._plan / "operations")
        shutil.rmtree(self._plan)
        return Ended(self.code, *texts, operations)

    def _take(self, seconds: float) -> None:
        ready, _, _ = select.select(list(self._ends.values()), [], [], seconds)
        for number, end in list(self._ends.items()):
            if end in ready:
                data = os.read(end, int(min(self._left[number], 65536)))
                self._texts[number] += data
                self._left[number] -= len(data)
                if not data:
                    self._left[number] = 0
        self._close_those_read()
        if not ready:
            if not self._ends:
                time.sleep(seconds)
            found, status = os.waitpid(self.pid, os.WNOHANG)
            self.code = os.waitstatus_to_exitcode(status) if found else None

    def _close_those_read(self) -> None:
        for number in [number for number in self._ends if self._left[number] == 0]:
            os.close(self._ends.pop(number))


def run(folder: Path, *argv: str, **more: Any) -> Ended:
    """One command, to its end."""
    return Command(folder, *argv, **more).wait()


def forked(function: Callable[..., Any], *arguments: Any) -> Any:
    """What a function returns in a process of its own, whose threads and libraries leave nothing here."""
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(read)
        try:
            found: Any = function(*arguments)
        except Skipped as reason:
            found = reason
        except BaseException:  # noqa: BLE001  it is raised there
            found = RuntimeError(traceback.format_exc())
        with os.fdopen(write, "wb") as out:
            pickle.dump(found, out)
        os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as stream:
        data = stream.read()
    os.waitpid(pid, 0)
    found = pickle.loads(data) if data else RuntimeError("the process died")
    if isinstance(found, Exception):
        raise found
    return found


def warm(folder: Path, *argv: str) -> None:
    """Import here what a command imports, which it does first in a process of its own."""
    from omnilab.runner import cli, hydra_app  # noqa: F401

    def modules() -> list[str]:
        os.chdir(folder)
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
            contextlib.suppress(SystemExit),
        ):
            cli.main(argv)
        return list(sys.modules)

    for name in forked(modules):
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    gc.freeze()  # or the collector would touch, and copy, all of it in each fork


def _become(
    folder: Path,
    argv: Sequence[str],
    pipes: Mapping[int, tuple[int, int]],
    env: Mapping[str, str],
    before: Callable[[], Any],
) -> None:
    """Be the command, from here to the end of the process."""
    os.setsid()
    os.chdir(folder)
    for number, (read, write) in pipes.items():
        os.close(read)
        os.dup2(write, number)
        os.close(write)
    void = os.open(os.devnull, os.O_RDONLY)
    os.dup2(void, 0)
    os.close(void)
    sys.stdout, sys.stderr = (open(number, "w", closefd=False) for number in (1, 2))  # noqa: SIM115
    sys.__stdout__, sys.__stderr__ = sys.stdout, sys.stderr
    os.environ.update(env)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    sys.argv = ["omnilab", *argv]
    try:
        before()
        ctypes.CDLL(None).torture_begin()
        from omnilab.__main__ import main

        main()
        code: object = 0
    except SystemExit as end:
        code = end.code
    except BaseException:  # noqa: BLE001  as Python does
        traceback.print_exc()
        code = 1
    ctypes.pythonapi.Py_Exit(
        code if isinstance(code, int) else 0
    )  # as at the end of any program, but not up our own stack


def _operations(log: Path) -> list[Operation]:
    if not log.exists():
        return []
    rows = (line.split(" ", 3) for line in log.read_text(errors="replace").splitlines())
    return [Operation(int(time_ns), name, path) for _, time_ns, name, path in sorted(rows, key=lambda row: int(row[0]))]
