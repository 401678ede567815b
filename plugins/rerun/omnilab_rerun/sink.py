"""The sink `rerun`."""

from __future__ import annotations

import os
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from omnilab.api import (
    Panel,
    Progress,
    Record,
    RunResult,
    Series,
    Text,
    Tick,
    ViewLayout,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, DataError
from omnilab.log_times import LogTimes
from omnilab.manifest import read_manifest
from omnilab.run_header import HEADER
from omnilab_rerun.curves import Curves
from omnilab_rerun.ports import LOOPBACK, is_free
from omnilab_rerun.records_seen import RecordsSeen
from omnilab_rerun.shown_header import ShownHeader

if TYPE_CHECKING:
    import rerun as rr

FILE = "run.rrd"
HAND_OVER_S = 0.1  # how long Rerun may gather records before it writes them


@dataclass
class RerunSink:
    """Writes `run.rrd`, which the Rerun viewer shows in the study's own layout; on request also while the run goes on.

    Records without a tick are static. The others lie on the timelines `step` (the study's), `sensor_time` (the sensor's
    clock) and `log_time` (the run's, on which all of a step lies where its first record was logged). What run it is, and
    how it ended, are properties of the recording, which Rerun's catalog lists as columns. The layout is there before the
    first image, with the run's header above it, and changes in its place: what was logged decides from where maps are seen,
    and what is shown.
    """

    live: bool = False  # serve the run on loopback while it goes on; `rerun --connect` shows it
    port: int = setting(9876, at_least=1, at_most=65_535)  # of the live server

    def __post_init__(self) -> None:
        check_settings(self)

    def open(self, folder: Path) -> None:
        """Start `run.rrd`; OSError if it cannot be written, ConfigError if the live port is taken.

        The viewer lists the recording under the folder that holds the run's: one experiment's runs share a layout.
        """
        import rerun as rr

        from omnilab_rerun import properties
        from omnilab_rerun.sent_layout import SentLayout
        from omnilab_rerun.writing import RecordingFile

        (folder / FILE).open("wb").close()  # rerun's own error names no path
        servers, self._manifest = self._server(), read_manifest(folder)
        self._stream = rr.RecordingStream(
            self._manifest.folder.parent.name,
            recording_id=self._manifest.unique_name,
            batcher_config=rr.ChunkBatcherConfig(flush_tick=HAND_OVER_S),
        )
        self._stream.set_sinks(rr.FileSink(folder / FILE), *servers)
        self._file = RecordingFile(folder / FILE)
        self._failed = False
        properties.begin(self._stream, self._manifest)
        self._times, self._tick = LogTimes(), Tick(0, 0)
        self._last_times: tuple[Tick, int, list[Any]] = self._tick, -1, []
        self._seen, self._curves = RecordsSeen(), Curves()
        self._header, self._sent = ShownHeader(), SentLayout(self._stream, self._manifest.folder.parent.name)
        self._layout: ViewLayout | None = None
        self._outdated = self._going = False
        self._result: RunResult | None = None

    def _server(self) -> list[rr.GrpcServerSink]:
        """The live server, if wanted. A taken port is found here, for rerun would only print it."""
        import rerun as rr

        if not self.live:
            return []
        if not is_free(self.port):
            raise ConfigError(
                f"port {self.port} is taken, so the run cannot be shown live; close the viewer or run that uses it, or set"
                " sinks.rerun.port"
            )
        return [rr.GrpcServerSink(bind_ip=LOOPBACK, port=self.port)]

    def write(self, path: str, record: Record, tick: Tick | None) -> None:
        """Take one record; ValueError if it has no form in Rerun, DataError if the file takes no more."""
        from rerun.error_utils import catch_and_log_exceptions

        self._check()
        if tick is not None:
            self._tick = tick
            self._outdated |= not self._going
            self._going = True
            self._lay_out()
        try:
            with catch_and_log_exceptions(strict=True):  # else it warns, and writes half of the record
                self._take(path, record, tick)
        except RuntimeError as error:
            self._check()  # was it the file?
            raise ValueError(str(error)) from error

    def _take(self, path: str, record: Record, tick: Tick | None) -> None:
        match record:
            case Progress():
                self._times.now()
                self._header.note(record)
                self._show_progress()
            case ViewLayout():
                self._layout, self._outdated = record, True
            case Series():
                self._send_curve(path, record)
            case _:
                self._outdated |= self._seen.add(path, record, still=tick is None)
                if tick is None and isinstance(record, Text) and path.strip("/") == HEADER:
                    self._begin(record)
                self._draw(path, record, tick)

    def _draw(self, path: str, record: Record, tick: Tick | None) -> None:
        from omnilab_rerun.drawing import draw
        from omnilab_rerun.owned import components, row

        log_ns = self._times.now() if tick is None else self._times.of_step(tick.step)
        if isinstance(record, Text) and not record.markdown:
            tick = tick or self._tick  # a static line would replace the last one: it goes where the run is
        for part, archetypes in draw(record, self._seen.spacing_m):
            if tick is None:
                self._stream.log(path + part, components(*archetypes), static=True, strict=True)
            else:  # `log` would add a time of its own
                self._stream.send_columns(path + part, self._times_of(tick, log_ns), row(*archetypes), strict=True)

    def _times_of(self, tick: Tick, log_ns: int) -> list[Any]:
        """Where a record lies on each timeline: made once for all records of a step."""
        from omnilab_rerun.owned import owned

        if self._last_times[:2] != (tick, log_ns):
            self._last_times = tick, log_ns, owned(_columns([tick.step], [tick.stamp_ns], [log_ns]))
        return self._last_times[2]

    def _lay_out(self) -> None:
        """Send the layout, if it has changed."""
        from omnilab_rerun.blueprint import blueprint

        if self._layout is not None and self._outdated:
            self._sent.send(blueprint(self._layout, self._seen, self._result, self._going))
            self._outdated = False

    def _begin(self, header: Text) -> None:
        """Take the run's header, above which a layout lies from the first one on."""
        self._header.begin(header)
        if self._layout is None:
            self._layout, self._outdated = ViewLayout([[Panel("log", "Log", ["log"])]]), True
            self._lay_out()

    def _show_progress(self) -> None:
        if (header := self._header.due()) is not None:
            self._draw(HEADER, header, None)

    def _send_curve(self, path: str, series: Series) -> None:
        import rerun as rr

        from omnilab_rerun.owned import components, owned

        self._seen.add(path, series, still=False)
        if (style := self._curves.new_style(path, series, self._seen.top(path))) is not None:
            self._stream.log(path, components(rr.SeriesLines(**style)), static=True, strict=True)
        log_ns = self._times.of_steps(series.steps)
        if len(log_ns) == 1:
            times = self._times_of(Tick(int(series.steps[0]), int(series.stamps_ns[0])), int(log_ns[0]))
        else:
            times = owned(_columns(series.steps, series.stamps_ns, log_ns))
        self._stream.send_columns(path, times, owned(rr.Scalars.columns(scalars=series.values)), strict=True)

    def flush(self) -> None:
        """Show how far the run is; DataError if the file takes no more.

        Rerun hands over what was logged by itself, within a tenth of a second. It is not asked to: asked while its writer
        gives up, it would wait for ever.
        """
        self._check()
        self._lay_out()
        self._show_progress()

    def _check(self) -> None:
        """DataError if the file takes no more."""
        import rerun as rr

        if not self._file.is_written():
            if not self._failed:
                self._stream.set_sinks(rr.FileSink(os.devnull))  # what has a dead writer cannot be closed
            self._failed = True
            raise DataError(f"{FILE} takes no more records; make room on the disk")

    def conclude(self, result: RunResult) -> None:
        """Say how the run ended, in the properties of the recording."""
        from omnilab_rerun import properties

        self._check()
        self._result, self._going, self._outdated = result, False, True
        properties.end(self._stream, self._manifest, result)

    def close(self) -> None:
        """Write what is left, and the footer; DataError if that is not possible."""
        from omnilab_rerun.writing import end

        if not self._failed:
            self._lay_out()
        self.__dict__.pop("_sent").close()  # sinks pickle, streams do not
        end(self.__dict__.pop("_stream"), self._file)
        if not self._failed and not self._file.is_whole():
            raise DataError(f"{FILE} could not be completed; make room on the disk")

    def repair(self, folder: Path) -> str | None:
        """Write a torn or damaged `run.rrd` anew with all its whole messages; None if it is whole or not there."""
        from omnilab_rerun.binary import repair

        return repair(folder / FILE)

    def view(
        self,
        folder: Path,
        screenshot: Path | None = None,
        step: int | None = None,
        size: tuple[int, int] = (1600, 900),
        header: str = "",
    ) -> None:
        """Open the recording in the viewer and wait until it is closed, or take its picture without a display.

        `step` is the moment shown in the picture (None: the last), `size` the picture's in pixels, `header` (in Markdown) is
        shown in place of the recording's own: a run that was killed could not say so.
        """
        from omnilab_rerun.shown_header import part_with
        from omnilab_rerun.viewer import check_there, show, take_picture

        recording = folder / FILE
        check_there(recording)
        with part_with(header, recording) if header else nullcontext() as part:
            parts = [part] if part else []
            if screenshot is None:
                show(recording, *parts)
            else:
                take_picture(recording, screenshot, step, size, *parts)


def _columns(steps: ArrayLike, stamps_ns: ArrayLike, log_ns: ArrayLike) -> list[rr.TimeColumn]:
    """Times (n,) of each timeline, ns."""
    import rerun as rr

    return [
        rr.TimeColumn("step", sequence=np.asarray(steps)),
        rr.TimeColumn("sensor_time", duration=np.asarray(stamps_ns).astype("timedelta64[ns]")),
        rr.TimeColumn("log_time", timestamp=np.asarray(log_ns).astype("datetime64[ns]")),
    ]
