"""Records of runs, from their folders."""

from __future__ import annotations

import math
from pathlib import Path

from omnilab.client import RunRecord, StageProgress
from omnilab.errors import DataError
from omnilab.runner.run_folder import RUNNING, UNREADABLE, LoadedRun


def run_record(run: LoadedRun, logs: Path) -> RunRecord:
    """A run as its folder tells; one that is damaged says why, as its error."""
    path = run.folder.resolve().relative_to(logs.resolve()).as_posix()
    try:
        state, manifest, status, metrics = run.state, run.manifest, run.status, run.metrics
    except DataError as error:
        return RunRecord(path, UNREADABLE, error=str(error))
    progress = run.progress if state == RUNNING else None
    return RunRecord(
        path,
        state,
        experiment=manifest["experiment"],
        overrides=[word for word in manifest["overrides"] if not word.startswith("experiment=")],
        components={slot: found["name"] for slot, found in manifest.get("components", {}).items()},
        metrics={name: None if math.isnan(value) else value for name, value in metrics.items()},
        intervals=run.intervals,
        units=run.units,
        host=manifest.get("host", {}).get("name"),
        error=status.get("error"),
        progress=StageProgress(progress.fraction or 0.0, progress.words, progress.left_s) if progress else None,
    )
