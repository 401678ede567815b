"""The sink `rerun`."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from omnilab.api import (
    Floats,
    PlaceMap,
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
from omnilab_rerun.ports import LOOPBACK, is_free

if TYPE_CHECKING:
    import rerun as rr

FILE = "run.rrd"
HAND_OVER_S = 0.1  # how long Rerun may gather records before it writes them


@dataclass
class RerunSink:
    """Writes `run.rrd`, which the Rerun viewer shows in the study's own layout; on request also while the run goes on.

    Records without a tick are static. The others lie on the timelines `step` (the study's), `sensor_time` (the sensor's
    clock) and `log_time` (the run's, on which all of a step lies where its first record was logged). What run it is, and
    how it ended, are properties of the recording, which Rerun's catalog lists as columns. The layout is sent with the first record that has a tick: what was logged
    before it decides from where its maps are seen.
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
        from omnilab_rerun.drawing import LONE_M
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
        self._spacing_m = LONE_M
        self._curves: set[str] = set()
        self._extents: dict[str, Floats] = {}
        self._layout: ViewLayout | None = None

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

        self.flush()
        if tick is not None:
            self._tick = tick
            self._lay_out()
        try:
            with catch_and_log_exceptions(strict=True):  # else it warns, and writes half of the record
                self._take(path, record, tick)
        except RuntimeError as error:
            self.flush()  # was it the file?
            raise ValueError(str(error)) from error

    def _take(self, path: str, record: Record, tick: Tick | None) -> None:
        match record:
            case Progress():
                self._times.now()
            case ViewLayout():
                self._layout = record
            case Series():
                self._send_curve(path, record)
            case _:
                if isinstance(record, PlaceMap):
                    self._space(record)
                if tick is None:
                    self._measure(path, record)
                self._draw(path, record, tick)

    def _draw(self, path: str, record: Record, tick: Tick | None) -> None:
        from omnilab_rerun.drawing import draw
        from omnilab_rerun.owned import components, owned, row

        log_ns = self._times.now() if tick is None else self._times.of_step(tick.step)
        if isinstance(record, Text) and not record.markdown:
            tick = tick or self._tick  # a static line would replace the last one: it goes where the run is
        for part, archetypes in draw(record, self._spacing_m):
            if tick is None:
                self._stream.log(path + part, components(*archetypes), static=True, strict=True)
            else:  # `log` would add a time of its own
                times = owned(_columns([tick.step], [tick.stamp_ns], [log_ns]))
                self._stream.send_columns(path + part, times, row(*archetypes), strict=True)

    def _space(self, places: PlaceMap) -> None:
        """Remember how fine the map is, for what is drawn."""
        from omnilab_rerun.drawing import LONE_M, spacing_m

        if not len(places.position_m):
            return
        # markers as large as the spacing of a coarse map would hide it, those of a very fine one would be too small
        extent = float(np.ptp(places.position_m, axis=0).max()) or 25 * LONE_M
        self._spacing_m = float(np.clip(spacing_m(places.position_m), extent / 150, extent / 25))

    def _measure(self, path: str, record: Record) -> None:
        """Remember how large the world is, for the eye."""
        from omnilab_rerun.blueprint import absolute
        from omnilab_rerun.drawing import points_of

        points = points_of(record)
        if absolute(path) not in self._extents and len(points):
            self._extents[absolute(path)] = np.stack([np.min(points, 0), np.max(points, 0)])

    def _lay_out(self) -> None:
        """Send the layout, once: of several, mending a torn file would pick any."""
        from omnilab_rerun.blueprint import blueprint

        if self._layout is not None:
            self._stream.send_blueprint(blueprint(self._layout, self._extents))
            self._layout = None

    def _send_curve(self, path: str, series: Series) -> None:
        import rerun as rr

        from omnilab_rerun.owned import components, owned

        if path not in self._curves:
            self._curves.add(path)
            name = f"{path.rsplit('/', 1)[-1]} [{series.unit}]"
            colors = None if series.color is None else [series.color]
            self._stream.log(path, components(rr.SeriesLines(names=name, colors=colors)), static=True, strict=True)
        times = _columns(series.steps, series.stamps_ns, self._times.of_steps(series.steps))
        values = rr.Scalars.columns(scalars=series.values)
        self._stream.send_columns(path, owned(times), owned(values), strict=True)

    def flush(self) -> None:
        """DataError if the file takes no more. Rerun hands over what was logged by itself, within a tenth of a second.

        It is not asked to: asked while its writer gives up, it would wait for ever.
        """
        import rerun as rr

        if not self._file.is_written():
            if not self._failed:
                self._stream.set_sinks(rr.FileSink(os.devnull))  # what has a dead writer cannot be closed
            self._failed = True
            raise DataError(f"{FILE} takes no more records; make room on the disk")

    def conclude(self, result: RunResult) -> None:
        """Say how the run ended, in the properties of the recording."""
        from omnilab_rerun import properties

        self.flush()
        properties.end(self._stream, self._manifest, result)

    def close(self) -> None:
        """Write what is left, and the footer; DataError if that is not possible."""
        from omnilab_rerun.writing import end

        if not self._failed:
            self._lay_out()
        end(self.__dict__.pop("_stream"), self._file)  # sinks pickle, streams do not
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
    ) -> None:
        """Open the recording in the viewer and wait until it is closed, or take its picture without a display.

        `step` is the moment shown in the picture (None: the last one that has an image), `size` the picture's in pixels.
        """
        from omnilab_rerun.viewer import show, take_picture

        if screenshot is None:
            show(folder / FILE)
        else:
            take_picture(folder / FILE, screenshot, step, size)


def _columns(steps: ArrayLike, stamps_ns: ArrayLike, log_ns: ArrayLike) -> list[rr.TimeColumn]:
    """Times (n,) of each timeline, ns."""
    import rerun as rr

    return [
        rr.TimeColumn("step", sequence=np.asarray(steps)),
        rr.TimeColumn("sensor_time", duration=np.asarray(stamps_ns).astype("timedelta64[ns]")),
        rr.TimeColumn("log_time", timestamp=np.asarray(log_ns).astype("datetime64[ns]")),
    ]
