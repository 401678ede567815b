"""A robot on its way: each image goes into the map, and what becomes of it into the logs."""

from __future__ import annotations

import time

import numpy as np

from omnilab.api import (
    Bytes,
    Floats,
    Frames,
    Graph,
    Image,
    IncrementalBackend,
    Ints,
    Parts,
    Plan,
    Pose,
    Recorder,
    Series,
    Text,
    Tick,
)
from omnilab.errors import ConfigError
from omnilab.posegraph.graph import matrices, vectors
from omnilab_studies.common.match_images import draw_matches
from omnilab_studies.common.samples import evenly
from omnilab_studies.trajectory.front_end import Mapper, Step

PATH, CLOSURE = (108, 122, 143), (42, 200, 92)
MAPS = 200  # at most so many stages of the map go into the logs: each holds all of it
NONE = Graph(np.zeros((0, 3)), np.zeros((0, 2), int))


class Way:
    """What is known of the way so far: the map, the steps, and the truth where the sensor knows it.

    The map starts at the true first pose. In the logs it is scaled as the true way's length so far says, so that it lies
    over the truth.
    """

    def __init__(self, parts: Parts, plan: Plan, record: Recorder, show: int, gap: float) -> None:
        if not isinstance(parts.backend, IncrementalBackend):
            raise ConfigError(f"{type(parts.backend).__name__} takes no poses as they come; give backend=gtsam_isam2")
        self._planned = plan.T_world_camera
        first = np.zeros(3) if self._planned is None else vectors(self._planned[:1], planar=True)[0]
        odometries = [parts.odometry, *parts.odometries.values()]
        self.mapper = Mapper(odometries, parts.loop_closure.begin(), parts.backend.begin(first), record, gap)
        self.steps: list[Step] = []
        self.keys: list[str] = []
        self.times_ms: list[float] = []
        self.taken: list[int] = []  # which of the plan's frames came
        self._record, self._flashed = record, False
        self._true = self._own = np.float64(0.0)  # lengths of the way so far: truly, and as it was mapped
        self._shown, self._stages = (set(evenly(len(plan), most).tolist()) for most in (show, MAPS))

    @property
    def truth(self) -> Floats | None:
        """The true poses (n, 4, 4) of the images so far, where they are known."""
        return None if self._planned is None else self._planned[self.taken]

    @property
    def closures(self) -> Ints:
        """Earlier and later node (L, 2) of each loop closure."""
        pairs = [(int(node), here) for here, step in enumerate(self.steps) for node in step.closures.nodes]
        return np.array(pairs, int).reshape(-1, 2)

    def take(self, frame: Frames, rng: np.random.Generator) -> None:
        """One more image, a batch of one."""
        start = time.perf_counter()
        step = self.mapper.take(frame, rng)
        self.steps.append(step)
        self.keys.append(frame.keys[0])
        self.taken.append(int(frame.plan_index[0]))
        self._tell(frame, step)
        self.times_ms.append(1e3 * (time.perf_counter() - start))
        tick = self.tick(len(self.steps) - 1)
        series = Series(np.array(self.times_ms[-1:]), np.array([tick.step]), np.array([tick.stamp_ns]), "ms")
        self._record.log("time/image", series)

    def tick(self, node: int) -> Tick:
        """When a node came."""
        return Tick(node, self.mapper.stamps_ns[node])

    def _tell(self, frame: Frames, step: Step) -> None:
        """Into the logs: where the robot is, what was recognised, what went wrong; now and then images and the map."""
        record, node = self._record, len(self.steps) - 1
        tick, scale = self.tick(node), self._scale()
        robot = self._over(self.mapper.online[-1:], scale)[0]
        record.log("robot", Pose(robot), tick)
        if step.trouble:
            record.log("log", Text(f"image {node}, {frame.keys[0]}: {step.trouble}; its step is bridged", "WARN"), tick)
        for sentence in step.warnings:
            record.log("log", Text(sentence, "WARN"), tick)
        closed = step.closures.nodes
        if len(closed):
            ends = self._over([*(self.mapper.online[int(i)] for i in closed), self.mapper.online[-1]], scale)
            edges = np.column_stack([np.arange(len(closed)), np.full(len(closed), len(closed))])
            flash = Graph(ends[:, :3, 3], edges, np.tile(np.array(CLOSURE, np.uint8), (len(closed), 1)))
            record.log("closures", flash, tick)
        elif self._flashed:
            record.log("closures", NONE, tick)
        self._flashed = len(closed) > 0
        if self.taken[-1] in self._shown or node == 0:
            record.log("query/image", Image(frame.images[0]), tick)
            record.log("query/panorama", Image(draw_matches(frame, step.motion)), tick)
            if frame.T_world_camera is not None:
                record.log("camera", Pose(frame.T_world_camera[0]), tick)
        if node and self.taken[-1] in self._stages:
            record.log("map", self.map(self.mapper.poses(), scale), tick)

    def map(self, poses: Floats, scale: float = 1.0) -> Graph:
        """The graph over poses (n, 3), loop closures in green."""
        return Graph(self._over(list(poses), scale)[:, :3, 3], self.mapper.graph().edges, self.colors)

    @property
    def colors(self) -> Bytes:
        """RGB (E, 3) of the map's edges: green those that close loops."""
        return np.where(self.mapper.loops[:, None], CLOSURE, PATH).astype(np.uint8)

    def _scale(self) -> float:
        """How much longer the true way is than the robot's own, so far."""
        if len(self.taken) > 1 and self._planned is not None:
            self._true += np.linalg.norm(np.subtract(*self._planned[self.taken[-2:], :2, 3]))
            self._own += np.linalg.norm(np.subtract(*np.array(self.mapper.online[-2:])[:, :2]))
        return float(self._true / self._own) if self._true > 0 and self._own > 0 else 1.0

    def _over(self, poses: list[Floats], scale: float) -> Floats:
        """Poses (n, 3) as transforms (n, 4, 4) over the truth: scaled about the first pose, as high as that."""
        first = matrices(self.mapper.online[0][None])[0]
        T = matrices(np.array(poses))
        T[:, :3, 3] = first[:3, 3] + scale * (T[:, :3, 3] - first[:3, 3])
        if self._planned is not None:
            T[:, 2, 3] = self._planned[0, 2, 3]
        return T
