"""The run folder: what a run leaves behind, and reading it again."""

from omnilab.runner.run_folder.latest import point_latest
from omnilab.runner.run_folder.names import (
    DONE,
    FAILED,
    INTERRUPTED,
    KILLED,
    RUNNING,
    SILENT,
    UNREADABLE,
    WARNINGS,
    new_folder_name,
)
from omnilab.runner.run_folder.origin import origin
from omnilab.runner.run_folder.reading import LoadedRun, find_runs, load_run
from omnilab.runner.run_folder.tables import write_csv
from omnilab.runner.run_folder.writing import RunFolder, metric_row

__all__ = [
    "DONE",
    "FAILED",
    "INTERRUPTED",
    "KILLED",
    "RUNNING",
    "SILENT",
    "UNREADABLE",
    "WARNINGS",
    "LoadedRun",
    "RunFolder",
    "find_runs",
    "load_run",
    "metric_row",
    "new_folder_name",
    "origin",
    "point_latest",
    "write_csv",
]
