"""Localisation in a saved map, frame by frame, as they come from a camera or a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from omnilab.api import Parts, PlaceMap, Recorder, Report, Text, Trainable, check_settings, setting
from omnilab_studies.common.live.pacing import PacedFrames, ReplayPace, WhenLate, one_at_a_time
from omnilab_studies.common.localization_metrics import METRIC_NAMES
from omnilab_studies.common.localization_run import LocalizationRun
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.pose_sources import Source, check_is_trajectory, plan_of_trajectory
from omnilab_studies.localization.live_localize.layout import LAYOUT
from omnilab_studies.localization.live_localize.live_run import LiveRun
from omnilab_studies.localization.localize.same_pictures import ComparedSensor

NO_TRUTH = "the sensor does not know where its frames were taken: answers are given, and no errors are known"


@dataclass
class LiveLocalize:
    """Localise frame by frame in a saved map (`map=FILE`), with the descriptor and distance that made it.

    With `pace=recorded` frames come at their own times, whether or not the one before is done, and with a camera as they are
    taken; the summary, `latency.csv` and a figure say how long after each frame its answer came, and how many were dropped.
    Which ones are depends on the machine, and so do the metrics, which are of the frames that were answered. With
    `pace=fast` none is dropped, and the same recording gives the same metrics each time.

    Where the sensor knows poses, answers are scored as `localize` does; where it does not, `answers.csv` has them.
    """

    images: Source = Source.recorded  # all that is recorded, in its order; or path
    path: str = "route"  # of the world, where images=path; or a file of poses (.txt, .tum, .csv)
    height_m: float | None = setting(
        None, at_least=-1e6, at_most=1e6
    )  # of the viewpoint on a path of the world; null: the sensor's own
    pace: ReplayPace = ReplayPace.fast  # fast, or recorded: at the times of the recording
    when_late: WhenLate = (
        WhenLate.queue
    )  # frames that come while others are not done: queue, or drop all but the newest
    waiting: int = setting(20, at_least=1, at_most=10_000)  # frames at most that wait, with when_late=queue
    show: int = setting(200, at_least=0)  # frames whose images go into the logs; the numbers of all of them do
    other_pictures: bool = False  # true: a camera, colours or a world other than the map's are meant

    needs: ClassVar[tuple[str, ...]] = ("sensor", "map", "localizer")  # the map brings descriptor and distance
    metric_names: ClassVar[tuple[str, ...]] = (*METRIC_NAMES, "distance_median", "dropped")
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        check_is_trajectory(self.images)

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Localise each frame as it comes; score where poses are known."""
        start_logs(record, LAYOUT, parts.sensor)
        plan = plan_of_trajectory(parts.sensor, self.images, self.path, self.height_m)
        if plan.T_world_camera is None:
            record.log("log", Text(NO_TRUTH, "NOTE"))
        live = LiveRun(self._prepared(parts, record), plan)
        frames = PacedFrames(self.pace, self.when_late, self.waiting)
        for arrived in frames.of(live.run.parts, plan, record, seed=int(rng.integers(2**32))):
            live.localize(arrived, frames)
        return live.report(frames, rng)

    def _prepared(self, parts: Parts, record: Recorder) -> LocalizationRun:
        """The map, ready to be asked."""
        if isinstance(parts.descriptor, Trainable):
            parts = replace(parts, descriptor=parts.descriptor.restore(parts.map.descriptor_state))
        sensor = ComparedSensor(one_at_a_time(parts.sensor), parts.map, parts.descriptor.color, self.other_pictures)
        run = LocalizationRun(replace(parts, sensor=sensor), parts.map, record, self.show)
        record.log("places", PlaceMap(run.places_m))
        return run
