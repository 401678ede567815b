"""The run folders below the logs, looked for again where a folder above them has changed.

Times of change are asked for, and nothing is subscribed to: disks of a network report no changes of other hosts.
"""

from __future__ import annotations

import os
import stat
import time
from dataclasses import dataclass, field
from pathlib import Path

from omnilab.runner.run_folder.names import STATUS
from omnilab_serve.index.records import OF_SWEEP

RACY_NS = 2 * 10**9  # a folder may change twice within one tick of its disk's clock, or of a network's
RECENT_NS = 600 * 10**9
REST = 5  # folders without a recent change are looked at every so many times

Stamp = tuple[int, int, int]  # of a file: what changes with its content


@dataclass
class _Folder:
    """A folder that is no run's, as it was when it was listed."""

    changed_ns: int = -1
    listed_ns: int = 0
    below: dict[str, int] = field(default_factory=dict)  # inodes of the folders in it, by name


class RunFolders:
    """Finds the runs and sweeps below a folder; paths are relative to it, with /. No link is followed."""

    def __init__(self, root: Path) -> None:
        self._root, self._turn = root, 0
        self._folders: dict[str, _Folder] = {}
        self.runs: set[str] = set()
        self.sweeps: set[str] = set()
        self._changed: set[str] = set()

    def poll(self, everything: bool = False) -> set[str]:
        """The paths at which a run has appeared, gone, or taken the place of another, since the last time.

        `everything`: list folders also where their times say that nothing has changed, as some network disks do.
        """
        self._turn += 1
        self._changed = set()
        if "" not in self._folders:
            self._list("")
        for path, folder in list(self._folders.items()):
            if everything or self._turn % REST == 0 or "/" not in path or _is_recent(folder):
                self._refresh(path, folder, everything)
        return self._changed

    def _refresh(self, path: str, folder: _Folder, everything: bool) -> None:
        try:
            changed_ns = os.stat(self._root / path).st_mtime_ns  # noqa: PTH116  for hundreds, each second
        except OSError:
            changed_ns = -1
        racy = folder.listed_ns - changed_ns < RACY_NS
        if everything or racy or changed_ns != folder.changed_ns:
            self._list(path)

    def _list(self, path: str) -> None:
        """List a folder, and those below it that are new."""
        waiting = [path]
        while waiting:
            waiting += self._list_one(waiting.pop())

    def _list_one(self, path: str) -> list[str]:
        """The folders in a folder that are to be listed, too."""
        place, listed_ns = self._root / path, time.time_ns()
        try:
            changed_ns = place.stat().st_mtime_ns
            with os.scandir(place) as entries:
                found = {entry.name: entry.inode() for entry in entries if _is_of_interest(entry)}
        except FileNotFoundError:
            self._drop(path)
            return []
        except OSError:  # a folder that cannot be listed may be a run's
            found, changed_ns = {STATUS: 0}, 0
        if STATUS in found and path:
            self._drop(path)
            self.runs.add(path)
            self._changed.add(path)
            return []
        (self.sweeps.add if found.keys() & OF_SWEEP else self.sweeps.discard)(path)
        below = {name: inode for name, inode in found.items() if name not in OF_SWEEP and name != STATUS}
        before = self._folders.get(path, _Folder()).below
        self._folders[path] = _Folder(changed_ns, listed_ns, below)
        for name in before:
            if below.get(name) != before[name]:
                self._drop(f"{path}/{name}".lstrip("/"))
        return [f"{path}/{name}".lstrip("/") for name in below if below[name] != before.get(name)]

    def _drop(self, path: str) -> None:
        """Forget a folder and what is below it."""
        self.sweeps.discard(path)
        if path in self.runs:
            self.runs.discard(path)
            self._changed.add(path)
        for name in self._folders.pop(path, _Folder()).below:
            self._drop(f"{path}/{name}".lstrip("/"))


def _is_of_interest(entry: os.DirEntry[str]) -> bool:
    """Whether an entry of a folder says what the folder is, or is a folder itself that an address can name."""
    return (
        entry.name in OF_SWEEP or entry.name == STATUS or (entry.is_dir(follow_symlinks=False) and _is_text(entry.name))
    )


def _is_text(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def _is_recent(folder: _Folder) -> bool:
    return abs(time.time_ns() - folder.changed_ns) < RECENT_NS


def stamp(file: Path) -> Stamp:
    """The time, size and inode of a file; zeros where there is none."""
    try:
        found = os.stat(file, follow_symlinks=False)  # noqa: PTH116
    except OSError:
        return 0, 0, 0
    return (found.st_mtime_ns, found.st_size, found.st_ino) if stat.S_ISREG(found.st_mode) else (0, 0, 1)
