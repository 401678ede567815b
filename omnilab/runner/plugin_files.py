"""Plugins that are single files: modules of this package, which any process can import.

A parallel launcher hands classes to its workers by the names of their modules. `omnilab.runner.plugin_files.NAME` is
found there as here: by the variable OMNILAB_PLUGINS, which a worker inherits.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from omnilab.errors import PluginError
from omnilab.file_kinds import is_file

VARIABLE = "OMNILAB_PLUGINS"
__path__: list[str] = []  # a package, though no folder has its modules


def chosen_plugins() -> list[str]:
    """The words of OMNILAB_PLUGINS."""
    return [word.strip() for word in os.environ.get(VARIABLE, "").split(",") if word.strip()]


def file_of(word: str) -> Path | None:
    """The file that a word of OMNILAB_PLUGINS names; None if it names a plugin."""
    if not word.endswith(".py") or word.startswith("-"):
        return None
    return Path(os.path.expanduser(word))  # noqa: PTH111  pathlib raises where there is no such user


def load_file(path: Path) -> ModuleType:
    """Import a plugin's file as a module; PluginError if there is none."""
    if not is_file(path):
        raise PluginError(f"there is no file {path}; correct the path in {VARIABLE}")
    if found := sys.modules.get(_module_name(path)):  # in a worker, by what was unpickled
        return found
    spec = importlib.util.spec_from_file_location(_module_name(path), path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses and pickles look the module up by its name
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[spec.name]
        raise
    return module


def _module_name(path: Path) -> str:
    digest = hashlib.sha256(os.fsencode(os.path.realpath(path))).hexdigest()[:8]  # two files may have the same name
    return f"{__name__}.{re.sub(r'[^0-9A-Za-z_]', '_', path.stem)}_{digest}"


class _Finder:
    """Imports the module of a file that OMNILAB_PLUGINS names, for what unpickles its classes."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:  # noqa: ARG002
        if fullname.startswith(f"{__name__}."):
            for file in filter(None, map(file_of, chosen_plugins())):
                if is_file(file) and _module_name(file) == fullname:
                    return importlib.util.spec_from_file_location(fullname, file)
        return None


sys.meta_path.append(_Finder())
