"""What the files of a run folder, and the states of a run, are called."""

from __future__ import annotations

import secrets
from datetime import datetime

STATUS, MANIFEST, CONFIG = "status.json", "manifest.json", "config.yaml"
RESERVED = "status.json.reserved"  # room for the last status, should the disk be full by then
METRICS = ["metric", "value", "unit", "low", "high", "note"]  # the columns of metrics.csv
WARNINGS, RUN_LOG = "warnings.txt", "run.log"
PROGRESS = "progress.json"
SUMMARY = "summary.csv"  # the table over a sweep's jobs
RUNNING, DONE, FAILED, INTERRUPTED, KILLED = "running", "done", "failed", "interrupted", "killed"
SILENT = "silent"  # it says "running", and whether its process lives cannot be told from here
UNREADABLE = "unreadable"  # what a damaged run is listed as


def new_folder_name() -> str:
    """`<date>_<time>-<hex>`: the hex parts runs that start in the same second."""
    return f"{datetime.now().astimezone():%Y-%m-%d_%H-%M-%S}-{secrets.token_hex(3)}"
