"""What `omnilab compare` says of runs and sweeps, kept until one of them changes."""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from omnilab.errors import ConfigError
from omnilab_serve.commands import run_command

MOST = 200  # folders of one comparison
KEPT = 32  # comparisons in memory
SIGNS = ("metrics.csv", "status.json", "summary.csv", "jobs.jsonl")  # files that are written when numbers change


class Comparisons:
    """Documents of `omnilab compare --json`, each computed in a process of its own, once for all who ask meanwhile."""

    def __init__(self, logs: Path) -> None:
        self._logs = logs.resolve()
        self._lock = threading.Lock()
        self._found: OrderedDict[str, dict[str, Any]] = OrderedDict()
        self._turns: dict[str, threading.Lock] = {}

    def document(self, folders: Sequence[Path]) -> dict[str, Any]:
        """All that is known of a comparison; of each run its `path` below the logs in the place of its folder.

        DataError with the command's own sentence if they cannot be compared.
        """
        key = comparison_key(folders)
        with self._lock:
            turn = self._turns.setdefault(key, threading.Lock())
        with turn:
            with self._lock:
                document = self._found.get(key)
            document = document or self._computed(folders)
            with self._lock:
                self._found[key] = document
                self._found.move_to_end(key)
                while len(self._found) > KEPT:
                    self._found.popitem(last=False)
                self._turns.pop(key, None)
        return document

    def _computed(self, folders: Sequence[Path]) -> dict[str, Any]:
        out = run_command(["compare", *map(str, folders), "--json"]).out
        document: dict[str, Any] = json.loads(out)
        for run in document["runs"]:
            run["path"] = Path(run.pop("folder")).relative_to(self._logs).as_posix()
        return document


def comparison_key(folders: Sequence[Path], signs: Sequence[str] = SIGNS) -> str:
    """Another one whenever the folders are others, or the numbers in one of them (`signs`: files) have changed."""
    if not folders:
        raise ConfigError("no run is named; give at least one, as run=PATH")
    if len(folders) > MOST:
        raise ConfigError(f"{len(folders)} runs are too many to be named one by one; up to {MOST}, or a sweep's folder")
    state = [[os.fspath(folder), *(_changed(folder / name) for name in signs)] for folder in folders]
    return hashlib.sha256(json.dumps(state).encode()).hexdigest()[:32]


def _changed(file: Path) -> tuple[int, int] | None:
    try:
        found = file.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size
