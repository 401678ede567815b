"""A plugin whose study ends as it is told, and has results to lose; for the tests of this folder."""

from __future__ import annotations

import errno
import os
import resource
import shutil
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnilab import Metric, Report, hookimpl
from omnilab.api import Places, Progress, Signatures, Text


class Figure:
    """Like a figure of matplotlib's, of so many bytes; or one that does otherwise when it is saved."""

    def __init__(self, size: int, does: str = "") -> None:
        self.size, self.does = size, does

    def savefig(self, out, format):
        ends(self.does)
        out.write(bytes(self.size))


def ends(how: str) -> None:
    """Do what a study, a figure or a sink might."""
    match how:
        case "exit":
            sys.exit(3)
        case "memory":
            raise MemoryError("Unable to allocate 11.2 GiB")
        case "recursion":
            ends(how)
        case "full":
            raise OSError(errno.ENOSPC, "No space left on device", "/data/frame.png")
        case "bug":
            raise ZeroDivisionError("a bug")
        case "unspeakable":
            raise Unspeakable
        case "SIGINT" | "SIGTERM" | "SIGHUP":
            os.kill(os.getpid(), getattr(signal, how))
            time.sleep(0.05)  # the handler has run
        case "twice":
            ends("SIGINT")
            ends("SIGINT")
        case "files":  # none can be opened from here on; what is open stays so
            resource.setrlimit(resource.RLIMIT_NOFILE, (3, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
        case "vanish":
            shutil.rmtree("logs")
        case "fill":  # the whole disk
            with suppress(OSError), Path("logs/filler").open("wb", buffering=0) as filler:
                while True:
                    filler.write(bytes(1 << 12))


class Unspeakable(LookupError):
    def __str__(self) -> str:
        raise ValueError("no message")


@dataclass
class Endings:
    """A study of one metric that ends as it is told."""

    how: str = "well"  # how `run` ends
    saving: str = ""  # what its second figure does when it is saved
    name: str = "extra.txt"  # of its file
    map_mb: float = 0.0  # size of its map
    value: float = 0.123456789
    say: int = 0  # warnings
    needs = ()

    def run(self, parts, record, rng):
        for i in range(self.say):
            record.log("log", Text(f"warning {i}", "WARN"))
        record.log("progress", Progress("work", 1, 1))
        ends(self.how)
        places = None
        if self.map_mb:
            rows = np.zeros((10, int(self.map_mb * 1e5 / 4)), np.float32)
            places = Places(Signatures(rows), None, [str(i) for i in range(10)])
        return Report(
            [Metric("precious", self.value, "m", (0.1, 0.2)), Metric("nothing", float("nan"), "1", note="none")],
            tables={"table": {"a": [1, 2], "b": [0.5, 0.25]}},
            figures={"first": Figure(40_000), "second": Figure(100, self.saving), "third": Figure(100)},
            files={self.name: "text\n"},
            map=places,
            summary="# found",
        )


@dataclass
class Closing:
    """A sink that ends as it is told when it is closed."""

    how: str = ""

    def open(self, folder): ...
    def write(self, path, record, tick): ...
    def flush(self): ...
    def close(self):
        ends(self.how)

    def repair(self, folder):
        return None


@hookimpl
def register_studies(register):
    register("endings", Endings)


@hookimpl
def register_sinks(register):
    register("closing", Closing)
