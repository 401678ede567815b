"""The study `matching`: odometries on pairs of images at given distances, against the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    CalibratedCamera,
    Floats,
    Frames,
    Image,
    Metric,
    Motion,
    Odometry,
    Parts,
    PlaceMap,
    Pose,
    RecordedPoses,
    Recorder,
    Report,
    Series,
    Tick,
    Unusable,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import wrap_angle
from omnilab.image import panorama
from omnilab_studies.common.frames import deliver
from omnilab_studies.common.logs import start_logs
from omnilab_studies.common.match_images import draw_image_pair
from omnilab_studies.common.pose_sources import Source, random_poses
from omnilab_studies.common.samples import of_known
from omnilab_studies.common.scores import known_poses
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.common.timing import timed
from omnilab_studies.matching import figures
from omnilab_studies.matching.layout import layout_of
from omnilab_studies.matching.pairs import Pair, agrees, images_of, looking, pairs_at, planar_direction, relative

Row = dict[str, Any]
PAIR_NS = 1_000_000_000  # between two pairs, in the logs
SOLVED_DEG = 2.0  # error of a rotation that is still a solution


@dataclass
class Matching:
    """Odometries side by side on pairs of images at given distances: matches that agree with the truth, errors, time.

    A match agrees if one point can have both of its directions, given the true motion. A pair is solved by a rotation within 2
    degrees. Pairs are chosen among random poses of the sensor, or of a recording: those whose distance is nearest.
    """

    distances_m: list[float] = setting([0.3, 0.6, 1.0, 2.0], above=0, fewest=1)  # of two images
    pairs: int = setting(20, at_least=1, at_most=10_000)  # for each distance
    source: Source = Source.random  # or recorded
    images: int = setting(400, at_least=2, at_most=5_000)  # random poses that pairs are chosen from
    tolerance_deg: float = setting(0.5, above=0, at_most=10)  # of a match from the truth

    needs: ClassVar[tuple[str, ...]] = ("sensor", "odometries")
    metric_names: ClassVar[tuple[str, ...]] = (
        "agreeing_ODOMETRY_DISTANCE", "solved_ODOMETRY_DISTANCE", "direction_error_median_ODOMETRY_DISTANCE",
        "rotation_error_median_ODOMETRY_DISTANCE",
    )  # fmt: skip
    cached: ClassVar[bool] = False  # it measures time

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        if self.source not in {Source.random, Source.recorded}:
            raise ConfigError(
                f"study.source={self.source.value} has no pairs at all distances; give random or recorded"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Choose pairs, extract and match each by every odometry, compare with the truth."""
        start_logs(record, layout_of(list(parts.odometries)), parts.sensor)
        seed = int(rng.integers(2**32))
        source = (
            RecordedPoses() if self.source is Source.recorded else random_poses(self.images, seed, None, None, None)
        )
        plan = parts.sensor.plan(source)
        T_world_camera = known_poses(plan.T_world_camera, "images")
        pairs = pairs_at(T_world_camera[:, :3, 3], self.distances_m, self.pairs)
        record.log("images", PlaceMap(T_world_camera[images_of(pairs)][:, :3, 3]))
        rows = []
        for i, (pair, (before, now)) in enumerate(zip(pairs, self._images(parts, plan, pairs, record), strict=True)):
            record.log("camera", Pose(T_world_camera[pair.now]), Tick(i, PAIR_NS * i))
            rows += [
                self._row(pair, name, odometry, before, now, np.random.default_rng([seed, i]), record, i)
                for name, odometry in parts.odometries.items()
            ]
        found = _summary(rows)
        tables = {"pairs": columns_of(rows), "matching": columns_of(found)}
        return Report(_metrics(found), tables, {"matching": figures.matching(found)}, summary=_markdown(found))

    def _images(self, parts: Parts, plan: Any, pairs: Sequence[Pair], record: Recorder) -> Any:
        """Both images of each pair, batches of one."""
        wanted = np.array([image for pair in pairs for image in (pair.before, pair.now)])
        held: list[Frames] = []
        for frames in deliver(parts, plan.at(wanted), record, "pairs"):
            if frames.omitted:
                raise DataError(f"an image of a pair is missing: {frames.omitted[0]}; leave it out of the recording")
            held += [frames.at(i) for i in range(len(frames))]
            while len(held) >= 2:
                yield held.pop(0), held.pop(0)

    def _row(
        self, pair: Pair, name: str, odometry: Odometry, before: Frames, now: Frames, rng: np.random.Generator,
        record: Recorder, step: int,
    ) -> Row:  # fmt: skip
        """One pair by one odometry."""
        (a, b), seconds = timed(lambda: (odometry.extract(before)[0], odometry.extract(now)[0]))
        unusable = next((each.reason for each in (a, b) if isinstance(each, Unusable)), "")
        motion, relate_s = Motion(np.full(3, np.nan), np.eye(3), "", unusable), math.nan
        if not unusable:
            motion, relate_s = timed(lambda: odometry.estimate(a, b, rng))
        _show(record, name, before, now, motion, Tick(step, PAIR_NS * step))
        agreeing, error_deg, direction_deg = self._judge(before, now, motion)
        curve = Series(np.array([float(agreeing)]), np.array([step]), np.array([PAIR_NS * step]), "1")
        record.log(f"agreeing/{name}", curve)
        return {
            "distance_m": pair.distance_m,
            "odometry": name,
            "before": before.keys[0],
            "now": now.keys[0],
            "matches": 0 if motion.matches is None else len(motion.matches),
            "agreeing": agreeing,
            "rotation_error_deg": error_deg,
            "direction_error_deg": direction_deg,
            "failed": motion.failed,
            "extract_ms": 1e3 * seconds / 2,
            "relate_ms": 1e3 * relate_s,
        }

    def _judge(self, before: Frames, now: Frames, motion: Motion) -> tuple[int, float, float]:
        """How many matches agree with the truth, and the errors of rotation and direction in degrees."""
        assert before.T_world_camera is not None
        assert now.T_world_camera is not None
        R, t = relative(before.T_world_camera[0], now.T_world_camera[0])
        x, y, rotation = motion.vector
        agreeing, direction = 0, math.atan2(y, x)
        if motion.matches is not None and len(motion.matches):
            if not isinstance(before.camera, CalibratedCamera):
                raise DataError(
                    f"a {type(before.camera).__name__} does not know where its pixels look, and matches cannot be compared"
                    " with the truth; give the images a calibration"
                )
            p, q = (looking(before.camera, motion.matches[:, k].astype(float)) for k in (0, 1))
            agreeing = int(agrees(p, q, R, t, np.deg2rad(self.tolerance_deg)).sum())
            if (
                np.isnan(direction) and motion.agree is not None and motion.agree.sum() >= 2
            ):  # no length, but a direction
                direction = planar_direction(p[motion.agree], q[motion.agree], rotation)
        rotation_off, direction_off = rotation - math.atan2(R[1, 0], R[0, 0]), direction - math.atan2(t[1], t[0])
        return agreeing, _degrees(rotation_off), _degrees(direction_off)


def _degrees(angle_rad: float) -> float:
    return float(np.rad2deg(np.abs(wrap_angle(angle_rad))))


def _show(record: Recorder, name: str, before: Frames, now: Frames, motion: Motion, tick: Tick) -> None:
    """The first image's panorama above the second's, with the inliers."""
    both = [panorama(frame.images, frame.camera)[0] for frame in (before, now)]
    record.log(f"matches/{name}", Image(draw_image_pair(both[0], both[1], motion)), tick)


def _summary(rows: Sequence[Row]) -> list[Row]:
    """One row for each odometry and distance."""
    found = []
    for name in dict.fromkeys(row["odometry"] for row in rows):
        by_name = [row for row in rows if row["odometry"] == name]
        times = {key: of_known(np.median, _column(by_name, key)) for key in ("extract_ms", "relate_ms")}
        for distance in dict.fromkeys(row["distance_m"] for row in by_name):
            own = [row for row in by_name if row["distance_m"] == distance]
            errors = {key: _column(own, f"{key}_error_deg") for key in ("rotation", "direction")}
            found.append({
                "odometry": name,
                "distance_m": distance,
                "pairs": len(own),
                "matches": float(_column(own, "matches").mean()),
                "agreeing": float(_column(own, "agreeing").mean()),
                "solved": int((errors["rotation"] < SOLVED_DEG).sum()),
                **{f"{key}_error_median_deg": of_known(np.median, each) for key, each in errors.items()},
                **times,
            })  # fmt: skip
    return found


def _column(rows: Sequence[Row], key: str) -> Floats:
    return np.array([row[key] for row in rows], float)


def _metrics(found: Sequence[Row]) -> list[Metric]:
    metrics = []
    for row in found:
        at = f"{row['odometry']}_{row['distance_m']:g}"
        metrics += [
            Metric(f"agreeing_{at}", row["agreeing"], "1"),
            Metric(f"solved_{at}", row["solved"] / row["pairs"], "1"),
        ]
        for key in ("direction_error_median", "rotation_error_median"):
            value = row[f"{key}_deg"]
            metrics.append(Metric(f"{key}_{at}", value, "deg", note="" if np.isfinite(value) else "no pair has one"))
    return metrics


def _markdown(found: Sequence[Row]) -> str:
    return "\n".join(["## Matches that agree with the truth", "", markdown(columns_of(found))])
