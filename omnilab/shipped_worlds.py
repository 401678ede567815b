"""The worlds that plugins ship, by name: beside its own, a virtual sensor finds these as `sensor.world=NAME`.

They are there once plugins have been looked for, as every command does; a script that uses a sensor alone gives a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

_files: dict[str, Path] = {}


def shipped_worlds() -> dict[str, Path]:
    """The files of the worlds that installed plugins ship."""
    return dict(_files)


def ship_worlds(files: Mapping[str, Path]) -> None:
    """Let these be the worlds there are: for what looks for plugins."""
    _files.clear()
    _files.update(files)
