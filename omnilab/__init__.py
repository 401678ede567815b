"""Experiments in omnidirectional vision: the names a plugin author needs."""

import sys
from typing import TYPE_CHECKING, Any

from omnilab import renamed

if TYPE_CHECKING:
    from omnilab.api import Frames, Match, Metric, Report, Signatures
    from omnilab.hooks import hookimpl

__all__ = ["Frames", "Match", "Metric", "Report", "Signatures", "hookimpl"]
__version__ = "0.1.0"

sys.meta_path.append(renamed.Finder())  # the last finder, for modules that no other finds


def __getattr__(name: str) -> Any:
    """Imported when they are wanted: the command guards itself against Ctrl-C before it imports anything large."""
    if name not in __all__:
        raise AttributeError(f"module 'omnilab' has no attribute {name!r}")
    from omnilab import api, hooks

    return getattr(hooks if name == "hookimpl" else api, name)
