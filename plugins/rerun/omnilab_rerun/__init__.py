"""Rerun recordings of omnilab runs."""

from __future__ import annotations

from functools import partial

from omnilab import hookimpl
from omnilab.hooks import Register, RegisterCommand, Runs
from omnilab_rerun.sink import RerunSink
from omnilab_rerun.view_command import view

__all__ = ["RerunSink"]


@hookimpl
def register_sinks(register: Register) -> None:
    register("rerun", RerunSink)


@hookimpl
def register_commands(register: RegisterCommand, runs: Runs) -> None:
    register("view", partial(view, runs))
