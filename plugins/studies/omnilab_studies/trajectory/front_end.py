"""A robot that maps its way as it goes: each image is joined to those before it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import (
    Bools,
    Closures,
    Floats,
    Frames,
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
from omnilab.posegraph.graph import moved

BRIDGE_STEPS = 3.0  # standard deviation of a step that was not measured, in usual steps
BRIDGE_RAD = 0.5  # and of its turn
RIGHT = -1  # group of edges whose lengths need no factor
NOTHING = np.full(3, np.nan)


class Step(NamedTuple):
    """What became of one image."""

    before: int  # the node that the motion starts from; below 0 where there was none
    motion: Motion | None  # as the run's odometry told it; None of the first image
    trouble: str  # why the step had to be bridged, in a few words; "" where it had not
    closures: Closures
    warnings: list[str]  # what went wrong with the map, in sentences


class Teller:
    """One odometry: the last image that it could use, and how its lengths compare with the map's."""

    def __init__(self, odometry: Odometry) -> None:
        self.odometry, self.unit = odometry, ""
        self.node, self.look = -1, None  # of the last image that it could use
        self.own = self.common = 0.0  # lengths told so far: as told, and what they were in the map's unit

    @property
    def factor(self) -> float:
        return self.common / self.own if self.own > 0 and self.common > 0 else 1.0

    def tell(self, frame: Frames, node: int, rng: np.random.Generator) -> tuple[int, Motion, Any]:
        """From which node, the motion from there, and what was kept of the image."""
        look, before = self.odometry.extract(frame)[0], self.node
        if isinstance(look, Unusable):
            return before, Motion(NOTHING, np.eye(3), self.unit, look.reason), look
        told = Motion(NOTHING, np.eye(3), self.unit, "it is the first usable image")
        if before >= 0:
            told = self.odometry.estimate(self.look, look, rng)
            self.unit = told.unit
        self.node, self.look = node, look
        return before, told, look


class Mapper:
    """Takes one image after the other: asks the odometries, bridges what they cannot tell, closes loops, grows the map.

    The first odometry is the run's own; motions of others join the graph beside its. Lengths are in metres if any of
    them tells metres, else in the unit of the first. An odometry with another unit has a factor, here how its lengths
    compare with the map's so far. An image that an odometry cannot use is skipped by it: the next one is compared with
    the last good one.
    """

    def __init__(
        self,
        odometries: Iterable[Odometry],
        memory: PlaceDatabase,
        growing: IncrementalGraph,
        record: Recorder,
        gap: float,
    ) -> None:
        self.tellers, self._record, self._gap = [Teller(o) for o in odometries], record, gap
        self._memory, self._growing = memory, growing
        self.stamps_ns: list[int] = []
        self.alone = [growing.pose(0)]  # where the run's odometry alone leads to, in its own unit
        self.online = [growing.pose(0)]  # each pose as it was when it came
        self._ends, self._motions, self._covariances = list[tuple[int, int]](), list[Floats](), list[Floats]()
        self._whose: list[int] = []  # of each edge: which odometry's lengths they are
        self._loops: list[bool] = []  # of each edge: whether it closes a loop
        self._steps: list[float] = []  # lengths of the own odometry's motions
        self._recent: Floats = np.zeros(3)  # its last motion

    @property
    def unit(self) -> str:
        """The map's unit of length."""
        units = [teller.unit for teller in self.tellers]
        return "m" if "m" in units else units[0]

    @property
    def factors(self) -> Floats:
        """What the lengths of each odometry (G,) are multiplied by to become the map's."""
        return np.array([teller.factor for teller in self.tellers])

    @property
    def groups(self) -> Ints:
        """Whose lengths those of each edge (E,) are; RIGHT where they are in the map's unit."""
        return self._groups(0)

    @property
    def loops(self) -> Bools:
        """Which edges (E,) close loops."""
        return np.array(self._loops, bool)

    def graph(self) -> PoseGraph:
        """All edges, lengths as they were told; and the poses as they came."""
        ends, motions, information = self._edges(0)
        return PoseGraph(np.arange(len(self.online)), np.array(self.online), ends, motions, information)

    def poses(self) -> Floats:
        """All poses (n, 3), as they are now."""
        return self._growing.poses()

    def take(self, frame: Frames, rng: np.random.Generator) -> Step:
        """The next image, a batch of one; DataError if it was not taken after the last one."""
        late = self._late(frame)
        node, start = len(self.stamps_ns), len(self._ends)
        self.stamps_ns.append(int(frame.stamps_ns[0]))
        with self._record.timed("odometry"):
            told = [teller.tell(frame, node, rng) for teller in self.tellers]
        usual = float(np.median(self._steps)) if self._steps else 1.0
        with self._record.timed("recall"):
            closures = self._memory.query(frame, told[0][2], usual, rng)
        if node == 0:
            return Step(-1, None, told[0][1].failed if isinstance(told[0][2], Unusable) else "", closures, [])
        trouble = self._join(node, [(before, motion) for before, motion, _ in told], late, usual)
        for earlier, motion, covariance in zip(closures.nodes, closures.motions, closures.covariances, strict=True):
            self._add(int(earlier), node, motion, covariance, 0, loop=True)
        ends, motions, information = self._edges(start)
        motions, information = scaled(motions, information, self._groups(start), self.factors)
        with self._record.timed("grow the map"):
            said = self._growing.add(moved(self._growing.pose(int(ends[0, 0])), motions[0]), ends, motions, information)
            self.online.append(self._growing.pose(node))
        return Step(told[0][0], told[0][1], trouble, closures, list(said))

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
        return waited / float(np.median(np.diff(self.stamps_ns))) if len(self.stamps_ns) > 2 else 1.0

    def _join(self, node: int, told: list[tuple[int, Motion]], late: float, usual: float) -> str:
        """Edges to the new node from earlier ones; why there had to be a bridge, in a few words."""
        gap = f"{late:.3g} times the usual time went by" if late > self._gap else ""
        sound = [] if gap else [k for k, (_, motion) in enumerate(told) if not motion.failed]
        self._compare([told[k][1] if k in sound else None for k in range(len(told))])
        for k in sound:
            self._add(told[k][0], node, told[k][1].vector, told[k][1].covariance, k)
        before, own = told[0]
        if 0 in sound:
            self._recent = own.vector
            self._steps.append(float(np.hypot(*own.vector[:2])))
        else:
            before, guess = node - 1, self._guess(node, told, sound, late)
            if not sound:
                wide = (BRIDGE_STEPS * usual * late) ** 2
                self._add(before, node, guess, np.diag([wide, wide, BRIDGE_RAD**2]), 0)
        self.alone.append(moved(self.alone[before], own.vector if 0 in sound else guess))
        return gap or own.failed

    def _guess(self, node: int, told: list[tuple[int, Motion]], sound: list[int], late: float) -> Floats:
        """The own odometry's motion from the last image where it was not measured well.

        As another one tells, or as it tells none the less, or ahead as in the last step.
        """
        for k in (*sound, 0):
            before, motion = told[k]
            if before == node - 1 and np.isfinite(motion.vector).all():
                ratio = self.tellers[k].factor / self.tellers[0].factor
                return np.asarray(motion.vector * [ratio, ratio, 1.0])
        return np.asarray(self._recent * [late, late, 0.0])

    def _compare(self, sound: list[Motion | None]) -> None:
        """Sum up what lengths are in the map's unit, where one odometry tells it and another one something else."""
        right = [motion for motion in sound if motion is not None and motion.unit == self.unit]
        if right:
            length = float(np.hypot(*right[0].vector[:2]))
            for teller, motion in zip(self.tellers, sound, strict=True):
                if motion is not None and teller.unit != self.unit:
                    teller.own += float(np.hypot(*motion.vector[:2]))
                    teller.common += length

    def _add(self, here: int, there: int, motion: Floats, covariance: Floats, teller: int, loop: bool = False) -> None:
        self._ends.append((here, there))
        self._motions.append(motion)
        self._covariances.append(covariance)
        self._whose.append(teller)
        self._loops.append(loop)

    def _groups(self, start: int) -> Ints:
        """Groups of the edges from one on."""
        right = [teller.unit in {"", self.unit} for teller in self.tellers]
        return np.array([RIGHT if right[k] else k for k in self._whose[start:]], int)

    def _edges(self, start: int) -> tuple[Ints, Floats, Floats]:
        """Ends (e, 2), motions (e, 3) and information (e, 3, 3) from one edge on, lengths as they were told."""
        information = np.linalg.inv(np.array(self._covariances[start:]).reshape(-1, 3, 3))
        information = (information + information.transpose(0, 2, 1)) / 2
        return np.array(self._ends[start:]), np.array(self._motions[start:]), information


def scaled(motions: Floats, information: Floats, groups: Ints, factors: Floats) -> tuple[Floats, Floats]:
    """Motions (E, 3) and information (E, 3, 3) with lengths times the factors (G,) of their groups (E,)."""
    factor = np.append(factors, 1.0)[groups]  # that of RIGHT is the last
    stretch = np.stack([factor, factor, np.ones_like(factor)], axis=1)
    return motions * stretch, information / (stretch[:, :, None] * stretch[:, None, :])
