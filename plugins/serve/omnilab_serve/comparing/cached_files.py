"""Files that commands write and the service hands out, kept in the user's cache until they are old."""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from omnilab.errors import DataError
from omnilab_serve.commands import run_command

KEY = re.compile(r"[0-9a-f]{32}")


@dataclass(frozen=True)
class FileCache:
    """Files of one kind, each by a key; the oldest go."""

    name: str  # of its folder
    suffix: str
    kept: int
    _writing: threading.Lock = field(default_factory=threading.Lock)

    @property
    def folder(self) -> Path:
        """Where programs of this user keep what they can make again."""
        given = Path(os.environ.get("XDG_CACHE_HOME", ""))
        return (given if given.is_absolute() else Path.home() / ".cache") / "omnilab" / self.name

    def make(self, key: str, command: Callable[[Path], Sequence[str]]) -> list[str]:
        """Let the command of a file write it, if it is not there yet: what was said besides.

        DataError with the command's own sentence if it fails.
        """
        warnings = list[str]()
        with self._writing:
            target = self.folder / f"{key}{self.suffix}"
            if not target.is_file():
                target.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
                warnings = run_command(command(target)).warnings.splitlines()
            os.utime(target)
            for old in sorted(self.folder.glob(f"*{self.suffix}"), key=lambda file: file.stat().st_mtime)[: -self.kept]:
                old.unlink(missing_ok=True)
        return [line.removeprefix("omnilab: ") for line in warnings if str(target) not in line]

    def file(self, key: str) -> Path:
        """The file of a key; DataError if there is none."""
        file = self.folder / f"{key}{self.suffix}"
        if not KEY.fullmatch(key) or not file.is_file():
            raise DataError("this file is no longer kept; load the page from which it came anew")
        return file
