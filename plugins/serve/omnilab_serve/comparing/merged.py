"""The recordings of several runs as one, which `omnilab view --save` writes."""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Sequence
from pathlib import Path

from omnilab.errors import DataError
from omnilab_serve.commands import run_command
from omnilab_serve.comparing.documents import comparison_key

KEY = re.compile(r"[0-9a-f]{32}")
KEPT = 6  # files, of which each is as large as its recordings
LARGEST = 4 << 30  # bytes of the recordings that are merged
_writing = threading.Lock()


def cache_folder() -> Path:
    """Where programs of this user keep what they can make again."""
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (given if given.is_absolute() else Path.home() / ".cache") / "omnilab" / "merged"


def merge_recordings(folders: Sequence[Path]) -> tuple[str, list[str]]:
    """Write the recordings of runs as one, if that was not done yet: its key, and what cannot be shown.

    DataError with the command's own sentence if none can be.
    """
    key, warnings = comparison_key(folders), list[str]()
    size = sum(file.stat().st_size for folder in folders if (file := folder / "run.rrd").is_file())
    if size > LARGEST:
        raise DataError(f"these recordings take {size / 1e9:.1f} GB together, more than a page can show; choose fewer")
    with _writing:
        target = cache_folder() / f"{key}.rrd"
        if not target.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            warnings = run_command(["view", *map(str, folders), "--save", str(target)]).warnings.splitlines()
        os.utime(target)
        for old in sorted(target.parent.glob("*.rrd"), key=lambda file: file.stat().st_mtime)[:-KEPT]:
            old.unlink(missing_ok=True)
    return key, [line.removeprefix("omnilab: ") for line in warnings if str(target) not in line]


def merged_recording(key: str) -> Path:
    """The file of a key; DataError if there is none."""
    file = cache_folder() / f"{key}.rrd"
    if not KEY.fullmatch(key) or not file.is_file():
        raise DataError("this merged recording is no longer there; open it from the comparison again")
    return file
