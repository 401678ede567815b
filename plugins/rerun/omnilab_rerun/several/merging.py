"""Recordings of several runs as one: each under its name, on the same steps."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import rerun as rr
from rerun.chunk import Chunk, LazyChunkStream, RrdReader

from omnilab.errors import DataError
from omnilab_rerun.colors import Color
from omnilab_rerun.several.contents import RecordingContents

APPLICATION, RECORDING = "omnilab view", "runs"
CURVE_LOOKS = ["SeriesLines:names", "SeriesLines:colors"]  # which are another run's, too


@dataclass(frozen=True)
class ShownRun:
    """A run among others: its recording, and what is known of it."""

    name: str
    color: Color
    recording: Path
    contents: RecordingContents

    @property
    def root(self) -> str:
        """The entity under which all of the run lies."""
        return f"/{rr.escape_entity_path_part(self.name)}"


def merge(runs: Sequence[ShownRun], target: Path) -> None:
    """Write all recordings into one, chunk by chunk; DataError if the disk does not allow it."""
    size, room = sum(run.recording.stat().st_size for run in runs), shutil.disk_usage(target.parent).free
    if size > room:
        raise DataError(
            f"the recordings together take {size / 1e6:.0f} MB, and {target.parent} has room for {room / 1e6:.0f}; set"
            " TMPDIR to a folder with more, or give fewer runs"
        )
    streams = [
        RrdReader(run.recording)
        .stream()
        .drop(content="/__properties/**")
        .drop(components=CURVE_LOOKS)
        .map(_under(run.root))
        for run in runs
    ]
    try:
        LazyChunkStream.merge(*streams).write_rrd(target, application_id=APPLICATION, recording_id=RECORDING)
    except (RuntimeError, OSError) as error:
        names = ", ".join(str(run.recording.parent) for run in runs)
        raise DataError(f"the recordings of {names} cannot be merged ({error}); view each alone") from error


def _under(root: str) -> Callable[[Chunk], Chunk]:
    return lambda chunk: chunk.with_entity_path(f"{root}{chunk.entity_path}")
