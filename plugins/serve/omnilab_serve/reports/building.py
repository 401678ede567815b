"""What a report says, and its page."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from markupsafe import Markup

from omnilab import __version__
from omnilab.client import SweepRecord
from omnilab.errors import DataError, visible
from omnilab.runner.run_folder import load_run
from omnilab.runner.run_folder.names import CONFIG, STATUS
from omnilab.runner.sweeps import load_sweep
from omnilab.runner.sweeps.snapshot import snapshot
from omnilab.runner.sweeps.status_table import overall
from omnilab_serve.comparing.charts import CurveChart, error_charts, metric_charts, recall_chart
from omnilab_serve.comparing.words import best_of
from omnilab_serve.index.records import run_record
from omnilab_serve.rendering import STATIC, templates
from omnilab_serve.reports.pictures import PictureBudget, ReportPicture
from omnilab_serve.run_details.details import WORST, RunDetails
from omnilab_serve.sweeps.grid import JobGrid, failures, job_grid
from omnilab_serve.sweeps.watched import sweep_with_jobs

MOST_RUNS = 8  # that are shown one by one
LONGEST_CONFIGURATION = 200_000  # characters
MAIN = 5  # metrics of a wide table, and half as many of charts
BESIDE = 4  # configurations that a sheet of paper is wide enough for, side by side


@dataclass(frozen=True)
class ReportedRun:
    """A run in a report."""

    details: RunDetails
    pictures: Sequence[ReportPicture]
    configuration: str
    folder: Path
    recording: str  # the name of the file beside; "": it is not there


@dataclass(frozen=True)
class ReportedSweep:
    """A sweep in a report."""

    record: SweepRecord
    words: str
    grid: JobGrid
    failures: Sequence[tuple[str, Sequence[Any]]]
    folder: Path


def report_page(folders: Sequence[Path], recordings: Mapping[Path, str]) -> str:
    """The page of a run, a sweep, or several; `recordings`: the names of those beside it.

    DataError if one of the folders is none of a run or sweep.
    """
    budget = PictureBudget()
    single = [folder for folder in folders if (folder / STATUS).is_file()]
    sweeps = [_sweep(folder) for folder in folders if folder not in single]
    runs = [_run(folder, recordings.get(folder, ""), budget) for folder in single[:MOST_RUNS]]
    document, why_not = _comparison(folders) if sweeps or len(single) > 1 else (None, "")
    style = (STATIC / "omnilab.css").read_text(encoding="utf-8") + (STATIC / "report.css").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    return templates().get_template("report.html").render(
        title=_title(runs, sweeps, len(single)), runs=runs, sweeps=sweeps, more=single[MOST_RUNS:], document=document,
        why_not=why_not, charts=_charts(document) if document else [], main=MAIN, beside=BESIDE,
        winners=best_of(document, "") if document else {}, style=Markup(style), digest=digest, version=__version__,
        made=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
    )  # fmt: skip


def _run(folder: Path, recording: str, budget: PictureBudget) -> ReportedRun:
    run = load_run(folder)
    details = RunDetails(run, run_record(run, folder.parent))
    names = [file.name for file in details.figures] + [WORST] * details.has_worst_picture
    try:
        text = "\n".join(map(visible, run.parsed(CONFIG, str.splitlines)))
    except DataError as error:
        text = str(error)
    return ReportedRun(details, list(budget.pictures(folder, names)), text[:LONGEST_CONFIGURATION], folder, recording)


def _sweep(folder: Path) -> ReportedSweep:
    seen = snapshot(load_sweep(folder))
    record = sweep_with_jobs(seen, lambda own: own.name)
    return ReportedSweep(record, overall(seen), job_grid(record), failures(record.jobs), folder)


def _comparison(folders: Sequence[Path]) -> tuple[dict[str, Any] | None, str]:
    """The document of `omnilab compare --json`, or why there is none."""
    from omnilab.runner.compare import compare_runs, comparison_document

    try:
        return comparison_document(compare_runs(folders)), ""
    except DataError as error:
        return None, str(error)


def _charts(document: Mapping[str, Any]) -> list[CurveChart]:
    curves = [chart for one in document["metrics"][:MAIN] for chart in metric_charts(document, one["name"])]
    recall = recall_chart(document)
    return [*error_charts(document), *([recall] if recall else []), *curves]


def _title(runs: Sequence[ReportedRun], sweeps: Sequence[ReportedSweep], count: int) -> str:
    if not sweeps and len(runs) == 1:
        return f"{runs[0].details.record.experiment or 'Run'}, {runs[0].folder.name}"
    if not count and len(sweeps) == 1:
        return f"{sweeps[0].record.experiment or 'Sweep'}, {sweeps[0].folder.name}"
    parts = [f"{count} runs"] * (count > 1) + ["a run"] * (count == 1)
    parts += [f"{len(sweeps)} sweeps"] * (len(sweeps) > 1) + ["a sweep"] * (len(sweeps) == 1)
    return f"{' and '.join(parts)} compared".capitalize()
