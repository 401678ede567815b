"""The run's header while it goes on, with how far it is; and of one that was killed, which could not say so."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from omnilab.api import Progress, Text
from omnilab.errors import DataError
from omnilab.run_header import HEADER, in_words, plain

EVERY_S, SHARE = 1.0, 0.01  # how often it is shown anew: each second, of a long run each hundredth of its time


@contextmanager
def part_with(header: str, recording: Path) -> Iterator[Path]:
    """A part of a recording, in a file that goes afterwards, in which the header says how the run stands by now."""
    import rerun as rr
    from rerun.chunk import RrdReader

    try:
        (whole, *_) = RrdReader(recording).recordings()
    except (RuntimeError, ValueError) as error:
        raise DataError(f"{recording} cannot be read back; mend it: omnilab repair {recording.parent}") from error
    with tempfile.TemporaryDirectory(prefix="omnilab-") as place:
        part = Path(place) / "header.rrd"
        stream = rr.RecordingStream(whole.application_id, recording_id=whole.recording_id, send_properties=False)
        stream.save(part)
        stream.log(HEADER, rr.TextDocument(header, media_type="text/markdown"), static=True)
        stream.disconnect()
        yield part


class ShownHeader:
    """The header as it was logged last, and when it is to be shown anew."""

    def __init__(self) -> None:
        self._text, self._stage, self._pending = "", "", False
        self._began = self._due = time.monotonic()

    def begin(self, header: Text) -> None:
        """The runner has logged it."""
        self._text, self._pending = header.text, False

    def note(self, progress: Progress) -> None:
        """A stage has come so far."""
        self._stage, self._pending = in_words(progress), True

    def due(self) -> Text | None:
        """The header with how far the run is; None if that has not changed, or was shown a moment ago."""
        now = time.monotonic()
        if not self._text or not self._pending or now < self._due:
            return None
        self._due, self._pending = now + max(EVERY_S, SHARE * (now - self._began)), False
        first, line, rest = self._text.partition("\n")
        return Text(f"{first}, {plain(self._stage)}{line}{rest}", markdown=True)
