"""A local web page for running, watching and reviewing experiments."""

from __future__ import annotations

from omnilab import hookimpl
from omnilab.hooks import CommandIn, RegisterCommand, Runs


@hookimpl
def register_commands(register: RegisterCommand, runs: Runs) -> None:  # noqa: ARG001  the service reads them itself
    register("serve", CommandIn("omnilab_serve.serve_command", "serve"))
    register("report", CommandIn("omnilab_serve.reports.command", "report"))
