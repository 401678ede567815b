"""What components return, checked where it passes from them to the run: shapes, types, finite numbers, counts, indices."""

from omnilab.runner.boundaries.guard import ending, guard
from omnilab.runner.boundaries.passing import read_only
from omnilab.runner.boundaries.reports import check_report, unsound
from omnilab.runner.boundaries.returns import check_declared

__all__ = ["check_declared", "check_report", "ending", "guard", "read_only", "unsound"]
