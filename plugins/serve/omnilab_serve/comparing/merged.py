"""The recordings of several runs as one, which `omnilab view --save` writes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omnilab.errors import DataError
from omnilab_serve.comparing.cached_files import FileCache
from omnilab_serve.comparing.documents import comparison_key

LARGEST = 4 << 30  # bytes of the recordings that are merged
MERGED = FileCache("merged", ".rrd", kept=6)


def merge_recordings(folders: Sequence[Path]) -> tuple[str, list[str]]:
    """Write the recordings of runs as one, if that was not done yet: its key, and what cannot be shown.

    DataError with the command's own sentence if none can be.
    """
    size = sum(file.stat().st_size for folder in folders if (file := folder / "run.rrd").is_file())
    if size > LARGEST:
        raise DataError(f"these recordings take {size / 1e9:.1f} GB together, more than a page can show; choose fewer")
    key = comparison_key(folders)
    return key, MERGED.make(key, lambda target: ["view", *map(str, folders), "--save", str(target)])
