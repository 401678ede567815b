"""The conformance check of sinks, and one record of every type."""

from __future__ import annotations

import io
import pickle
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext, redirect_stderr
from pathlib import Path
from typing import Any

import numpy as np

from omnilab import api
from omnilab.api import Tick
from omnilab.geometry import planar_poses
from omnilab.image import encode
from omnilab.testing.common import expect
from omnilab.testing.rules import Trial, Work, conform, rule


def check_sink(sink: Any, folder: Path | None = None) -> None:
    """Takes every record, with and without a tick, and a result; completes its files, which need no repair; pickles.

    It writes into `folder`, or into one that is removed afterwards.
    """
    conform(SinkTrial(sink, folder))


class SinkTrial(Trial):
    """A sink, one record of every type, and a folder."""

    kind = "sink"

    def __init__(self, sink: Any, folder: Path | None = None) -> None:
        super().__init__(sink)
        self.folder = folder

    @contextmanager
    def _written(self) -> Iterator[Path]:
        """The folder, in which all has been written."""
        made = tempfile.TemporaryDirectory() if self.folder is None else nullcontext(self.folder)
        with ExitStack() as shown, made as name:
            folder = Path(name)
            shown.enter_context(redirect_stderr(io.StringIO()))  # what a console shows of made-up records
            self.given.open(folder)
            for path, record, tick in sample_records():
                self.given.write(path, record, tick)
                self.given.flush()
            if isinstance(self.given, api.TakesResult):
                metrics = [api.Metric("rate", 0.5, "1"), api.Metric("error", np.nan, "m")]
                self.given.conclude(api.RunResult("done", metrics))
            self.given.close()
            yield folder

    def work(self) -> Work:
        def call() -> None:
            with self._written():
                pass

        return Work(call, len(list(sample_records())), "record")

    @rule("takes a record of every type, and completes files that need no repair")
    def takes_all(self) -> None:
        with self._written() as folder:
            repaired = self.given.repair(folder)
            expect(repaired is None, f"a run that ended well needs repair: {repaired}; complete the files in `close`")

    @rule("survives pickling after it was used, as sweeps need it")
    def pickles_closed(self) -> None:
        try:
            pickle.loads(pickle.dumps(self.given))  # noqa: S301  our own bytes
        except (TypeError, AttributeError, pickle.PicklingError) as error:
            raise AssertionError(
                f"after `close` it is not pickled ({error}); have `close` drop files and writers"
            ) from error


def sample_records() -> Iterator[tuple[str, api.Record, Tick | None]]:
    """One record of every kind, with made-up but sound content."""
    rng = np.random.default_rng(3)
    picture = rng.integers(0, 255, (16, 24, 3), dtype=np.uint8)
    position_m = rng.uniform(-1, 1, (9, 3))
    steps = np.arange(4)
    tick = Tick(3, 300_000_000)
    panel = api.Panel("image", "Camera", ("camera/image",))
    yield "", api.ViewLayout(((panel,),)), None
    yield "room", api.Mesh(position_m[:3], np.array([[0, 1, 2]]), picture[0, :3]), None
    yield "cloud", api.PointCloud(position_m, picture[0, :9]), tick
    yield "graph", api.Graph(position_m, np.array([[0, 1], [1, 2]])), tick
    yield "springs", api.Graph(position_m, np.array([[0, 1], [1, 2]]), picture[0, :2]), tick
    yield "places", api.PlaceMap(position_m, rng.uniform(-3, 3, 9)), None
    yield "camera/image", api.Image(picture, "png", encode(picture, "png")), tick
    yield "camera", api.Pose(planar_poses([[1.0, 2.0, 3.0]], np.pi / 2)[0]), tick
    yield "signature", api.Signature(rng.random((5, 7), dtype=np.float32)), tick
    yield "distances", api.DistanceField(position_m, rng.random(9, dtype=np.float32)), tick
    yield "estimate", api.Estimate(position_m[0], position_m[1], "wrong", 0.5, None), tick
    yield "answers", api.Answers(position_m, position_m[::-1], ["nearest"] * 8 + ["wrong"]), None
    yield "error", api.Series(rng.random(4), steps, steps * 100_000_000, "m"), None
    yield "log", api.Text("a line", "WARN"), tick
    yield "summary", api.Text("# Title", markdown=True), None
    yield "progress", api.Progress("places", 3, 9), None
