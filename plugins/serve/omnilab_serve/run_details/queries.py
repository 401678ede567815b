"""The queries of a run that went worst."""

from __future__ import annotations

import csv
import heapq
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from omnilab_serve.run_details.files import open_file

QUERIES = "queries.csv"
MOST_BYTES = 16 * 2**20  # a table of about a hundred thousand queries
WORST = 10
ERROR = "error_m"
COLUMNS = {  # those that are shown, if there are any
    "query": "Query", ERROR: "Error [m]", "heading_error_deg": "Heading error [deg]", "verdict": "Verdict",
    "truth_x_m": "x [m]", "truth_y_m": "y [m]", "answer_x_m": "Answer x [m]", "answer_y_m": "Answer y [m]", "rank": "Rank",
}  # fmt: skip


def worst_queries(folder: Path) -> Sequence[Mapping[str, str]]:
    """The queries with the largest errors, the worst first, by the titles of columns; none without a table of them."""
    try:
        with open_file(folder / QUERIES) as file:
            text = file.read(MOST_BYTES).decode("utf-8", "replace")
    except OSError:
        return []
    try:
        rows = [row for row in csv.DictReader(text.splitlines()) if _error(row) is not None]
    except csv.Error:  # no table of ours
        return []
    worst = heapq.nlargest(WORST, rows, key=lambda row: _error(row) or 0.0)
    return [{title: str(row[name]) for name, title in COLUMNS.items() if row.get(name)} for row in worst]


def _error(row: Mapping[str, str]) -> float | None:
    """None for a query without an answer, or without truth."""
    try:
        error = float(row.get(ERROR) or "")
    except ValueError:
        return None
    return error if math.isfinite(error) else None
