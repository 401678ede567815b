"""The worlds that need no file: listed without what loads them, which takes longer to import than to list them."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from omnilab.shipped_worlds import shipped_worlds


def shipped() -> dict[str, Path]:
    """The files of the worlds that come with this plugin, then those of others, by name."""
    found = (Path(str(file)) for file in (files("omnilab_mirror") / "worlds").iterdir())
    return {file.stem: file for file in sorted(found) if file.suffix == ".yaml"} | shipped_worlds()
