"""What components return, checked where it passes from them to the run: shapes, types, finite numbers, counts, indices."""

from omnilab.runner.boundaries.guard import ending, guard
from omnilab.runner.boundaries.passing import read_only
from omnilab.runner.boundaries.records import unsound_record
from omnilab.runner.boundaries.reports import check_report, unsound
from omnilab.runner.boundaries.returns import check_declared
from omnilab.runner.boundaries.spot_checks import SpotCheck, quarter_shifted, quarter_turned

__all__ = [
    "SpotCheck",
    "check_declared",
    "check_report",
    "ending",
    "guard",
    "quarter_shifted",
    "quarter_turned",
    "read_only",
    "unsound",
    "unsound_record",
]
