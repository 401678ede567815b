"""What a log says of its run: a metadata record, and files of the run's folder as attachments."""

from __future__ import annotations

import shlex
from pathlib import Path

from omnilab.api import RunResult
from omnilab.file_kinds import content_of
from omnilab.manifest import Manifest

NAME = "omnilab"  # of the metadata record
RUN_FILES = {"manifest.json": "application/json", "config.yaml": "application/yaml"}  # by name, their media types
RESULT_FILES = {"metrics.csv": "text/csv"}
LARGEST_BYTES = 4 * 2**20  # of an attachment
LONGEST = 2000  # characters of an error


def of_run(manifest: Manifest) -> dict[str, str]:
    """What is known of a run when it starts; overrides are quoted as a shell would read them."""
    seed = "" if manifest.seed is None else str(manifest.seed)
    known = {
        "id": manifest.id,
        "experiment": manifest.experiment,
        "overrides": shlex.join(manifest.overrides),
        "seed": seed,
        "identity": manifest.identity,
    }
    return {"run": manifest.name, "status": "running"} | {name: text for name, text in known.items() if text}


def of_result(result: RunResult) -> dict[str, str]:
    """How it ended, and its metrics, each as `metrics.NAME`: the shortest digits that give the same number."""
    metrics = {f"metrics.{metric.name}": repr(float(metric.value)) for metric in result.metrics}
    return {"status": result.status} | ({"error": result.error[:LONGEST]} if result.error else {}) | metrics


def files(folder: Path, media_types: dict[str, str]) -> list[tuple[str, str, bytes]]:
    """Name, media type and content of the files that are in the folder and no larger than an attachment may be."""
    found = []
    for name, media_type in media_types.items():
        try:
            found.append((name, media_type, content_of(folder / name, LARGEST_BYTES)))
        except OSError:  # not there, or too large: the folder has it
            continue
    return found
