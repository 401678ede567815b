"""The studies: code that drives components and measures."""

from omnilab.hooks import Register, hookimpl
from omnilab_studies.grid import Grid

__all__ = ["Grid"]


@hookimpl
def register_studies(register: Register) -> None:
    register("grid", Grid)
