"""Front end of graph SLAM: each image's odometry and loop closures become edges of the pose graph."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import (
    Bools,
    Closures,
    Floats,
    Frames,
    ImageFeatures,
    IncrementalGraph,
    Ints,
    Motion,
    Odometry,
    PlaceDatabase,
    PoseGraph,
    Recorder,
    Unusable,
)
from omnilab.errors import DataError
from omnilab.metrics import middle
from omnilab.posegraph.graph import moved

BRIDGE_STEPS = 3.0  # standard deviation of a step that was not measured, in usual steps
BRIDGE_RAD = 0.5  # and of its rotation
MAP_UNIT = -1  # group of edges whose lengths need no factor
NOTHING = np.full(3, np.nan)


class MappingStep(NamedTuple):
    """What the front end made of one image."""

    before: int  # the node that the motion starts from; below 0 where there was none
    motion: Motion | None  # the estimate of the run's odometry; None of the first image
    bridged: str  # why the step had to be bridged, in a few words; "" where it had not
    closures: Closures
    warnings: list[str]  # what went wrong with the map, in sentences


class OdometryEstimate(NamedTuple):
    """What one odometry made of one image."""

    before: int  # the node that the motion starts from
    motion: Motion
    features: Any  # extracted from the image


class OdometryTracker:
    """One odometry along the trajectory: the last image it could use, and the ratio of its lengths to the map's."""

    def __init__(self, odometry: Odometry) -> None:
        self.odometry, self.unit = odometry, ""
        self.node, self.features = -1, None  # of the last image that it could use
        self.own_length = self.map_length = 0.0  # of the motions so far, in its own unit and in the map's

    @property
    def factor(self) -> float:
        """What its lengths are multiplied by to become the map's."""
        return self.map_length / self.own_length if self.own_length > 0 and self.map_length > 0 else 1.0

    def estimate(self, frame: Frames, node: int, rng: np.random.Generator) -> OdometryEstimate:
        """The motion since the last usable image; a failed one where there is none, or this image is unusable."""
        features, before = self.odometry.extract(frame)[0], self.node
        if isinstance(features, Unusable):
            return OdometryEstimate(before, Motion(NOTHING, np.eye(3), self.unit, features.reason), features)
        motion = Motion(NOTHING, np.eye(3), self.unit, "it is the first usable image")
        if before >= 0:
            motion = self.odometry.estimate(self.features, features, rng)
            self.unit = motion.unit
        self.node, self.features = node, features
        return OdometryEstimate(before, motion, features)


class FrontEnd:
    """Takes one image after the other: estimates motions, bridges those that failed, closes loops, adds all to the graph.

    The first odometry is the run's own; motions of others join the graph beside its. Lengths are in metres if any of
    them estimates metres, else in the unit of the first. An odometry with another unit has a factor, here the ratio of
    the map's lengths to its own so far. An image that an odometry cannot use is skipped by it: the next one is compared
    with the last good one.
    """

    def __init__(
        self,
        odometries: Iterable[Odometry],
        database: PlaceDatabase,
        incremental: IncrementalGraph,
        record: Recorder,
        gap: float,
    ) -> None:
        self.trackers, self._record, self._gap = [OdometryTracker(o) for o in odometries], record, gap
        self._database, self._incremental = database, incremental
        self.stamps_ns: list[int] = []
        self.odometry_poses = [incremental.pose(0)]  # by the run's odometry alone, in its own unit
        self.online_poses = [incremental.pose(0)]  # each pose as it was when it came
        self._ends, self._motions, self._covariances = list[tuple[int, int]](), list[Floats](), list[Floats]()
        self._odometry_of: list[int] = []  # of each edge: which odometry's lengths they are
        self._loops: list[bool] = []  # of each edge: whether it closes a loop
        self._steps: list[float] = []  # lengths of the own odometry's motions, in their order by size
        self._intervals: list[int] = []  # between images, in the same order
        self._last_motion: Floats = np.zeros(3)  # of the own odometry

    @property
    def unit(self) -> str:
        """The map's unit of length."""
        units = [tracker.unit for tracker in self.trackers]
        return "m" if "m" in units else units[0]

    @property
    def factors(self) -> Floats:
        """What the lengths of each odometry (G,) are multiplied by to become the map's."""
        return np.array([tracker.factor for tracker in self.trackers])

    @property
    def groups(self) -> Ints:
        """Which odometry's lengths those of each edge (E,) are; MAP_UNIT where they are in the map's unit."""
        return self._groups(0)

    @property
    def loops(self) -> Bools:
        """Which edges (E,) close loops."""
        return np.array(self._loops, bool)

    @property
    def ends(self) -> Ints:
        """The nodes (E, 2) that each edge leads from and to."""
        return np.array(self._ends, int).reshape(-1, 2)

    def graph(self) -> PoseGraph:
        """All edges, lengths as they were estimated; and the poses as they came."""
        ends, motions, information = self._edges(0)
        return PoseGraph(np.arange(len(self.online_poses)), np.array(self.online_poses), ends, motions, information)

    def poses(self) -> Floats:
        """All poses (n, 3), as they are now."""
        return self._incremental.poses()

    def process(self, frame: Frames, rng: np.random.Generator) -> MappingStep:
        """Add the next image, a batch of one; DataError if it was not taken after the last one."""
        late = self._late(frame)
        node, start = len(self.stamps_ns), len(self._ends)
        self.stamps_ns.append(int(frame.stamps_ns[0]))
        with self._record.timed("odometry"):
            estimates = [tracker.estimate(frame, node, rng) for tracker in self.trackers]
        own = estimates[0]
        usual = middle(self._steps) if self._steps else 1.0
        with self._record.timed("recall"):
            closures = self._database.query(frame, _shared(own.features), usual, rng)
        if node == 0:
            reason = own.motion.failed if isinstance(own.features, Unusable) else ""
            return MappingStep(-1, None, reason, closures, [])
        bridged = self._add_odometry(node, estimates, late, usual)
        self._add_closures(node, closures)
        warnings = self._add_pose(node, start)
        return MappingStep(own.before, own.motion, bridged, closures, warnings)

    def _late(self, frame: Frames) -> float:
        """How many usual intervals have gone by since the last image."""
        if not self.stamps_ns:
            return 1.0
        waited = int(frame.stamps_ns[0]) - self.stamps_ns[-1]
        if waited <= 0:
            raise DataError(
                f"image {frame.keys[0]} was taken {-waited / 1e9:g} s before the one it follows; put the images in the"
                " order of their times"
            )
        late = waited / middle(self._intervals) if len(self._intervals) > 1 else 1.0
        insort(self._intervals, waited)
        return late

    def _add_odometry(self, node: int, estimates: list[OdometryEstimate], late: float, usual: float) -> str:
        """Edges of the estimates to the new node, or a bridge; why there had to be one, in a few words."""
        gap = f"{late:.3g} times the usual time went by" if late > self._gap else ""
        sound = [] if gap else [k for k, estimate in enumerate(estimates) if not estimate.motion.failed]
        self._compare_lengths([estimates[k].motion if k in sound else None for k in range(len(estimates))])
        for k in sound:
            self._add(estimates[k].before, node, estimates[k].motion.vector, estimates[k].motion.covariance, k)
        before, own, _ = estimates[0]
        if 0 in sound:
            step = self._last_motion = own.vector
            insort(self._steps, float(np.hypot(*own.vector[:2])))
        else:
            before, step = node - 1, self._guess(node, estimates, sound, late)
            if not sound:
                wide = (BRIDGE_STEPS * usual * late) ** 2
                turn = BRIDGE_RAD**2 if gap or _turn(node, estimates[0]) is None else own.covariance[2, 2]
                self._add(before, node, step, np.diag([wide, wide, turn]), 0)
        self.odometry_poses.append(moved(self.odometry_poses[before], step))
        return gap or own.failed

    def _guess(self, node: int, estimates: list[OdometryEstimate], sound: list[int], late: float) -> Floats:
        """A motion (3,) from the last image, in the own odometry's unit, where that has no sound estimate.

        Another odometry's estimate, or the own one that is not trusted, or straight ahead as in the last step, turned as
        the own estimate has it where it failed for its length alone.
        """
        for k in (*sound, 0):
            before, motion, _ = estimates[k]
            if before == node - 1 and np.isfinite(motion.vector).all():
                ratio = self.trackers[k].factor / self.trackers[0].factor
                return np.asarray(motion.vector * [ratio, ratio, 1.0])
        return np.append(self._last_motion[:2] * late, _turn(node, estimates[0]) or 0.0)

    def _compare_lengths(self, motions: list[Motion | None]) -> None:
        """Sum up the lengths of each odometry and the same in the map's unit, where one of them is in that."""
        in_map_unit = [motion for motion in motions if motion is not None and motion.unit == self.unit]
        if in_map_unit:
            length = float(np.hypot(*in_map_unit[0].vector[:2]))
            for tracker, motion in zip(self.trackers, motions, strict=True):
                if motion is not None and tracker.unit != self.unit:
                    tracker.own_length += float(np.hypot(*motion.vector[:2]))
                    tracker.map_length += length

    def _add_closures(self, node: int, closures: Closures) -> None:
        """Edges of loop closures to the new node, lengths in the own odometry's unit."""
        for earlier, motion, covariance in zip(closures.nodes, closures.motions, closures.covariances, strict=True):
            self._add(int(earlier), node, motion, covariance, 0, loop=True)

    def _add_pose(self, node: int, start: int) -> list[str]:
        """Add the new pose with its edges, from `start` on, to the incremental graph; warnings."""
        ends, motions, information = self._edges(start)
        motions, information = scaled(motions, information, self._groups(start), self.factors)
        with self._record.timed("grow the map"):
            guess = moved(self._incremental.pose(int(ends[0, 0])), motions[0])
            warnings = self._incremental.add(guess, ends, motions, information)
            self.online_poses.append(self._incremental.pose(node))
        return list(warnings)

    def _add(
        self, here: int, there: int, motion: Floats, covariance: Floats, odometry: int, loop: bool = False
    ) -> None:
        self._ends.append((here, there))
        self._motions.append(motion)
        self._covariances.append(covariance)
        self._odometry_of.append(odometry)
        self._loops.append(loop)

    def _groups(self, start: int) -> Ints:
        """Groups of the edges from one on."""
        in_map_unit = [tracker.unit in {"", self.unit} for tracker in self.trackers]
        return np.array([MAP_UNIT if in_map_unit[k] else k for k in self._odometry_of[start:]], int)

    def _edges(self, start: int) -> tuple[Ints, Floats, Floats]:
        """Ends (e, 2), motions (e, 3) and information (e, 3, 3) from one edge on, lengths as they were estimated."""
        information = np.linalg.inv(np.array(self._covariances[start:]).reshape(-1, 3, 3))
        information = (information + information.transpose(0, 2, 1)) / 2
        return np.array(self._ends[start:]), np.array(self._motions[start:]), information


def _turn(node: int, estimate: OdometryEstimate) -> float | None:
    """The turn since the last image, where an estimate that failed has it and its variance: the length alone is not known."""
    turn, variance = estimate.motion.vector[2], estimate.motion.covariance[2, 2]
    return float(turn) if estimate.before == node - 1 and np.isfinite([turn, variance]).all() else None


def _shared(features: Any) -> ImageFeatures | Unusable | None:
    """What a loop closure may use of an odometry's features; see `omnilab.api.PlaceDatabase.query`."""
    return features if isinstance(features, ImageFeatures | Unusable) else None


def scaled(motions: Floats, information: Floats, groups: Ints, factors: Floats) -> tuple[Floats, Floats]:
    """Motions (E, 3) and information (E, 3, 3) with lengths times the factors (G,) of their groups (E,)."""
    factor = np.append(factors, 1.0)[groups]  # that of MAP_UNIT is the last
    stretch = np.stack([factor, factor, np.ones_like(factor)], axis=1)
    return motions * stretch, information / (stretch[:, :, None] * stretch[:, None, :])
