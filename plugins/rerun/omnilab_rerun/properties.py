"""What a run is, as properties of its recording: Rerun's catalog lists them as columns, `property:run:seed` and the like."""

from __future__ import annotations

from collections.abc import Mapping

import pyarrow as pa
import rerun as rr

from omnilab.api import RunResult
from omnilab.manifest import Manifest
from omnilab_rerun.owned import row

RUN, METRICS = "run", "metrics"


def begin(stream: rr.RecordingStream, manifest: Manifest) -> None:
    """What is known when the run starts: its status is running."""
    stream.send_recording_name(manifest.name)
    _send(stream, RUN, _of_run(manifest, "running"))


def end(stream: rr.RecordingStream, manifest: Manifest, result: RunResult) -> None:
    """How it ended, and its metrics, float64; NaN of one without a value."""
    _send(stream, METRICS, {metric.name: pa.array([metric.value], pa.float64()) for metric in result.metrics})
    error = {"error": pa.array([result.error])} if result.error else {}
    _send(stream, RUN, _of_run(manifest, result.status) | error)


def _of_run(manifest: Manifest, status: str) -> dict[str, pa.Array]:
    texts = {"experiment": manifest.experiment, "identity": manifest.identity, "status": status}
    known = {name: pa.array([text]) for name, text in texts.items() if text}
    known["overrides"] = pa.array(manifest.overrides, pa.string())
    if manifest.seed is not None:
        known["seed"] = pa.array([manifest.seed], pa.int64())
    return known


def _send(stream: rr.RecordingStream, name: str, values: Mapping[str, pa.Array]) -> None:
    """One property, in place of what was sent of it before.

    In a message of its own, with all that the one before had: of rows in one message, and of messages with different
    columns, Rerun's catalog shows any.
    """
    if values:
        stream.send_columns(f"/__properties/{name}", [], row(rr.AnyValues(**values)), strict=True)
