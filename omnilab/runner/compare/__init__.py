"""Comparing runs and sweeps: what differs, metrics over seeds, errors query by query, tables and figures."""

from omnilab.runner.compare.comparison import RunComparison, compare_runs
from omnilab.runner.compare.document import comparison_document
from omnilab.runner.compare.error_curves import ErrorCurve, error_curves
from omnilab.runner.compare.figures import draw
from omnilab.runner.compare.gathering import LeftOut
from omnilab.runner.compare.order import best_first, by_setting
from omnilab.runner.compare.paired import PairedErrors, paired_errors
from omnilab.runner.compare.tables import write_csv

__all__ = [
    "ErrorCurve",
    "LeftOut",
    "PairedErrors",
    "RunComparison",
    "best_first",
    "by_setting",
    "compare_runs",
    "comparison_document",
    "draw",
    "error_curves",
    "paired_errors",
    "write_csv",
]
