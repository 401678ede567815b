"""Experiments in omnidirectional vision: the names a plugin author needs.

All of `omnilab.api` (the Protocol of each kind, the data that pass between them, the records for the logs), and of others
what is in `ELSEWHERE`.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from omnilab import renamed

if TYPE_CHECKING:
    from omnilab.api import *
    from omnilab.errors import ConfigError as ConfigError
    from omnilab.errors import DataError as DataError
    from omnilab.hooks import Register as Register
    from omnilab.hooks import RegisterFolder as RegisterFolder
    from omnilab.hooks import hookimpl as hookimpl

ELSEWHERE = dict.fromkeys(("ConfigError", "DataError"), "errors")
ELSEWHERE |= dict.fromkeys(("Register", "RegisterFolder", "hookimpl"), "hooks")
__version__ = "0.1.0"

sys.meta_path.append(renamed.Finder())  # the last finder, for modules that no other finds


def __getattr__(name: str) -> Any:
    """Imported when they are wanted: the command guards itself against Ctrl-C before it imports anything large."""
    if name[:1] != "_":
        module = import_module(f"omnilab.{ELSEWHERE.get(name, 'api')}")
        if name in ELSEWHERE or name in module.__all__:
            return getattr(module, name)
    raise AttributeError(f"module 'omnilab' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *import_module("omnilab.api").__all__, *ELSEWHERE})
