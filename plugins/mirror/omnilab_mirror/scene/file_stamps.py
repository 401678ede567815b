"""When files were changed, by which a change is noticed."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

Stamp = tuple[int, int]  # time of the last change in nanoseconds, size in bytes


def stamp_of(file: Path) -> Stamp:
    """When a file was changed, and its size; zeros where there is none."""
    if not file.is_file():
        return 0, 0
    return file.stat().st_mtime_ns, file.stat().st_size


def stamps_of(paths: Iterable[Path]) -> dict[Path, Stamp]:
    """The stamps of files."""
    return {path: stamp_of(path) for path in paths}
