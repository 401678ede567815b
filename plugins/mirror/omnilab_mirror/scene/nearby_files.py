"""Files that a world or a mesh names: only those in its folder or below are read."""

from __future__ import annotations

import unicodedata
from pathlib import Path


def file_below(folder: Path, name: str) -> Path:
    """The absolute path of a file that is named relative to a folder; ValueError says why it may not be read."""
    if "\0" in name:
        raise ValueError("its name holds a NUL character")
    root = folder.resolve()
    try:
        path = _found(root / name).resolve()
    except RuntimeError:  # of pathlib
        raise ValueError("its symbolic links run in a circle") from None
    if not path.is_relative_to(root):
        raise ValueError("it lies outside the folder")
    return path


def _found(path: Path) -> Path:
    """The path, or the one that is there and looks the same: letters with accents are one character or two (NFC, NFD)."""
    if str(path).isascii() or path.exists():
        return path
    found = Path(path.anchor)
    for part in path.parts[1:]:
        there = found / part
        if not there.exists() and found.is_dir():
            there = next((other for other in found.iterdir() if _composed(other.name) == _composed(part)), there)
        found = there
    return found


def _composed(name: str) -> str:
    return unicodedata.normalize("NFC", name)
