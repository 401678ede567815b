"""Discovery of plugins by a command, which says what went wrong with them."""

from __future__ import annotations

from omnilab.runner.registry import Registry, discover
from omnilab.runner.terminal import print_error


def discover_loudly() -> Registry:
    """All plugins; a line on standard error for each that failed, or has words of the version before."""
    registry = discover()
    for note in registry.notes:
        print_error(note)
    for failure in registry.failures:
        print_error(f"{failure.sentence} (omnilab plugins -v shows the traceback)")
    return registry
