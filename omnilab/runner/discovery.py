"""Discovery of plugins by a command, which says what went wrong with them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from omnilab.runner.interrupts import uninterrupted
from omnilab.runner.terminal import print_error

if TYPE_CHECKING:
    from omnilab.runner.registry import Registry


def discover() -> Registry:
    """All plugins. Hydra is imported with them, which takes longer than to list a thousand runs, and here only."""
    with uninterrupted():
        from omnilab.runner.registry import discover as found
    return found()


def discover_loudly() -> Registry:
    """All plugins; a line on standard error for each that failed, or has words of the version before."""
    registry = discover()
    for note in registry.notes:
        print_error(note)
    for failure in registry.failures:
        print_error(f"{failure.sentence} (omnilab plugins -v shows the traceback)")
    return registry
