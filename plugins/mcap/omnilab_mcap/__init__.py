"""MCAP logs of omnilab runs."""

from omnilab import hookimpl
from omnilab.hooks import Register
from omnilab_mcap.sink import McapSink

__all__ = ["McapSink"]


@hookimpl
def register_sinks(register: Register) -> None:
    register("mcap", McapSink)
