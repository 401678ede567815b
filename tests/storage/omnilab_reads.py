"""A plugin for tests of inputs: a study that reads a file, or all files of a folder."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from omnilab import Metric, Report, hookimpl
from omnilab.errors import DataError


@dataclass
class Reads:
    """Sums the numbers in files."""

    path: str = "???"
    others: list[str] = field(default_factory=list)
    needs = ()
    metric_names = "total", "files"

    def run(self, parts, record, rng):
        total = count = 0
        for path in map(Path, [self.path, *self.others]):
            files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
            if not files or not files[0].exists():
                raise DataError(f"there is no {path}")
            total, count = total + sum(int(file.read_text()) for file in files), count + len(files)
        return Report([Metric("total", total, "1"), Metric("files", count, "1")])


@hookimpl
def register_studies(register):
    register("reads", Reads)
