"""Rerun recordings of omnilab runs."""

from __future__ import annotations

from omnilab import hookimpl
from omnilab.hooks import Register
from omnilab_rerun.sink import RerunSink

__all__ = ["RerunSink"]


@hookimpl
def register_sinks(register: Register) -> None:
    register("rerun", RerunSink)
