"""A local web page for running, watching and reviewing experiments."""

from __future__ import annotations

from omnilab import hookimpl
from omnilab.hooks import RegisterCommand, Runs
from omnilab_serve.reports import report
from omnilab_serve.serve_command import serve


@hookimpl
def register_commands(register: RegisterCommand, runs: Runs) -> None:  # noqa: ARG001  the service reads them itself
    register("serve", serve)
    register("report", report)
