"""Virtual worlds and mirror cameras for omnilab."""

from __future__ import annotations

from omnilab import hookimpl
from omnilab.hooks import Register
from omnilab_mirror.mirror import Mirror

__all__ = ["Mirror"]


@hookimpl
def register_sensors(register: Register) -> None:
    register("mirror", Mirror)
