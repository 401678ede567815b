"""The sink `mcap`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from omnilab.api import Record, RunResult, Series, Tick

if TYPE_CHECKING:
    from omnilab_mcap.log import McapLog

FILE = "run.mcap"


@dataclass
class McapSink:
    """Writes every record into `run.mcap`, as protobuf messages that Foxglove, PlotJuggler and Rerun show."""

    def __post_init__(self) -> None:
        self._log: McapLog | None = None

    def open(self, folder: Path) -> None:
        """Start `run.mcap` in the run folder; DataError if it cannot be created or is there already."""
        from omnilab_mcap.log import McapLog

        self._log = McapLog(folder / FILE)

    def write(self, path: str, record: Record, tick: Tick | None) -> None:
        """Add one record under the topic `/path`; OSError if the disk fails."""
        from omnilab_mcap import messages

        topic, log = f"/{path.strip('/')}", self._opened()
        if isinstance(record, Series):
            log.add_rows(topic, messages.scalars(record))
        else:
            log_ns = log.times.now() if tick is None else log.times.of_step(tick.step)
            tick = tick or Tick(0, log_ns)
            for subtopic, message in messages.messages(record, topic, tick):
                log.add(subtopic, message, log_ns, tick)

    def flush(self) -> None:
        """Complete the chunk in progress. What was written is with the operating system already."""
        self._opened().flush()

    def conclude(self, result: RunResult) -> None:
        """Say how the run ended, in the metadata `omnilab`, and attach `metrics.csv`."""
        self._opened().conclude(result)

    def close(self) -> None:
        """Complete the file with its index."""
        log, self._log = self._opened(), None
        log.close()

    def repair(self, folder: Path) -> str | None:
        """Write a torn or damaged `run.mcap` anew with all whole chunks; DataError if it is no MCAP log."""
        from omnilab_mcap.repair import repair

        return repair(folder / FILE)

    def _opened(self) -> McapLog:
        if self._log is None:
            raise RuntimeError("the sink 'mcap' is not open; call open(folder) first")
        return self._log
