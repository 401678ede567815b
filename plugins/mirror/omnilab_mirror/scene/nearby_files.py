"""Files that a world or a mesh names: only regular files in its folder or below are read, and only so many bytes."""

from __future__ import annotations

from pathlib import Path


def file_below(folder: Path, name: str) -> Path:
    """The absolute path of a file that is named relative to a folder; ValueError says why it may not be read."""
    if "\0" in name:
        raise ValueError("its name holds a NUL character")
    root = folder.resolve()
    try:
        path = (root / name).resolve()
    except RuntimeError:  # of pathlib
        raise ValueError("its symbolic links run in a circle") from None
    if not path.is_relative_to(root):
        raise ValueError("it lies outside the folder")
    return path


def bytes_of(path: Path, limit: int) -> bytes:
    """The content of a regular file of up to `limit` bytes; OSError or ValueError says why it cannot be read."""
    size = path.stat().st_size
    if not path.is_file():  # a pipe would be waited for, a device has no end
        raise ValueError("it is no regular file")
    if size > limit:
        raise ValueError(f"it has {size} bytes, more than {limit}")
    return path.read_bytes()
