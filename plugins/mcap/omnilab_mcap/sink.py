"""The sink `mcap`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from omnilab.api import Record, RunResult, Series, Tick, ViewLayout
from omnilab.atomic_files import write_whole

if TYPE_CHECKING:
    from omnilab_mcap.log import McapLog

FILE, LAYOUT = "run.mcap", "foxglove_layout.json"


@dataclass
class McapSink:
    """Writes every record into `run.mcap`, as protobuf messages that Foxglove, PlotJuggler and Rerun show.

    Beside it lies at the end the study's layout for Foxglove, `foxglove_layout.json`.
    """

    def __post_init__(self) -> None:
        self._log: McapLog | None = None
        self._layout: ViewLayout | None = None

    def open(self, folder: Path) -> None:
        """Start `run.mcap` in the run folder; DataError if it cannot be created or is there already."""
        from omnilab_mcap.log import McapLog

        self._log, self._layout = McapLog(folder / FILE), None

    def write(self, path: str, record: Record, tick: Tick | None) -> None:
        """Add one record under the topic `/path`; OSError if the disk fails."""
        from omnilab_mcap import messages
        from omnilab_mcap.foxglove_layout import check_panels

        topic, log = f"/{path.strip('/')}", self._opened()
        if isinstance(record, ViewLayout):
            check_panels(record)
            self._layout = record
        elif isinstance(record, Series):
            log.add_rows(topic, messages.scalars(record))
            log.see(topic, record)
        else:
            log_ns = log.times.now() if tick is None else log.times.of_step(tick.step)
            tick = tick or Tick(0, log_ns)
            for subtopic, message in messages.messages(record, topic, tick):
                log.add(subtopic, message, log_ns, tick)
                log.see(subtopic, record)

    def flush(self) -> None:
        """Complete the chunk in progress. What was written is with the operating system already."""
        self._opened().flush()

    def conclude(self, result: RunResult) -> None:
        """Say how the run ended, in the metadata `omnilab`, and attach `metrics.csv`."""
        self._opened().conclude(result)

    def close(self) -> None:
        """Complete the file with its index, and write the layout; OSError without room for either."""
        from omnilab_mcap.foxglove_layout import foxglove_layout

        log, self._log = self._opened(), None
        log.close()
        if self._layout is not None and (text := foxglove_layout(self._layout, log.shown)):
            write_whole(log.folder / LAYOUT, lambda out: out.write(text.encode()))

    def repair(self, folder: Path) -> str | None:
        """Write a torn or damaged `run.mcap` anew with all whole chunks; DataError if it is no MCAP log."""
        from omnilab_mcap.repair import repair

        return repair(folder / FILE)

    def _opened(self) -> McapLog:
        if self._log is None:
            raise RuntimeError("the sink 'mcap' is not open; call open(folder) first")
        return self._log
