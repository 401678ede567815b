"""What `omnilab plugins` lists, kept in the user's cache: while nothing has changed, it is printed without an import.

A listing says that plugins load. So it is kept only where all of them do, and all are of omnilab[all]: what these register
depends on files alone. It holds while Python is the same, and every file that was imported, every folder that was looked
into and all that says what is installed are as they were, by the time and the size of each. Of plugins of others nobody
knows what they look at: where there is one, all are loaded, each time.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from omnilab.atomic_files import write_whole
from omnilab.runner.plugin_files import chosen_plugins

RACE_S = 2.0  # what is younger may have changed after it was imported: some disks know no more than seconds
INSTALLED = ("*.pth", "*.dist-info", "*.dist-info/METADATA", "*.dist-info/entry_points.txt",
             "*.egg-info", "*.egg-info/PKG-INFO", "*.egg-info/entry_points.txt")  # fmt: skip

Stamp = list[int] | None  # of a file or folder; None: it is not there


class Listed(NamedTuple):
    """A component, a recipe or a world."""

    name: str
    origin: str
    summary: str


Listing = list[tuple[str, list[Listed]]]  # by kind


def kept() -> Listing | None:
    """What was listed, if it would be so again; None where that is not known."""
    with suppress(OSError, ValueError, LookupError, TypeError, RuntimeError):  # none yet, or damaged: it is made anew
        found = json.loads(_file().read_bytes())
        if found["python"] == _python() and all(_stamp(path) == stamp for path, stamp in found["stamps"].items()):
            return [(str(kind), [Listed(*map(str, row)) for row in rows]) for kind, rows in found["listing"]]
    return None


def keep(listing: Listing, folders: Iterable[Path], began_s: float) -> None:
    """Keep what was listed for the next time. `folders`: of recipes and worlds; `began_s`: when the first was read."""
    stamps = {path: _stamp(path) for path in {*map(os.path.abspath, _sources(folders))}}
    newest_s = max(time_ns for stamp in stamps.values() if stamp for time_ns in stamp[:2]) / 1e9
    if newest_s > began_s - RACE_S:
        return
    content = json.dumps({"python": _python(), "stamps": stamps, "listing": listing}).encode()
    with suppress(OSError, RuntimeError):  # it can be had without: the next time takes as long as this one
        _file().parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_whole(_file(), lambda out: out.write(content))


def _file() -> Path:
    """One for each environment of Python; RuntimeError where the user has no home."""
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    folder = (given if given.is_absolute() else Path.home() / ".cache") / "omnilab"
    return folder / f"plugins-{sha256(os.fsencode(sys.prefix)).hexdigest()[:16]}.json"


def _python() -> list[object]:
    """What decides, beside files, what is found and how it is read."""
    paths = [*map(os.path.abspath, sys.path)]
    return [sys.version, sys.executable, repr(sys.flags), sys.warnoptions, paths, chosen_plugins()]


def _stamp(path: str) -> Stamp:
    try:
        found = Path(path).stat()
    except OSError:
        return None
    return [found.st_mtime_ns, found.st_ctime_ns, found.st_size]


def _sources(folders: Iterable[Path]) -> Iterator[str | Path]:
    """All that a listing was made of."""
    for module in list(sys.modules.values()):
        if file := getattr(module, "__file__", None):
            yield from (file, Path(file).parent)
    for folder in map(Path, sys.path):
        yield folder
        for pattern in INSTALLED:
            yield from folder.glob(pattern)
    for folder in folders:
        yield folder
        yield from folder.rglob("*")
