"""Mapping run: the images of a trajectory go through the front end, and each step into the logs."""

from __future__ import annotations

import time
from collections.abc import Callable

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
    Record,
    Recorder,
    Series,
    Text,
    Tick,
)
from omnilab.errors import ConfigError
from omnilab.posegraph.graph import matrices, vectors
from omnilab_studies.common.match_images import draw_matches
from omnilab_studies.common.samples import evenly
from omnilab_studies.trajectory.front_end import FrontEnd, MappingStep

PATH, CLOSURE = (108, 122, 143), (42, 200, 92)
MAPS = 200  # at most so many stages of the map go into the logs: each holds all of it
Aside = Callable[[Callable[[], object]], object]
Drawn = tuple[str, Record | Callable[[], Record]]  # the path of a record; and it, or what draws it
NONE = Graph(np.zeros((0, 3)), np.zeros((0, 2), int))


class MappingRun:
    """The trajectory so far: the map, the steps, and the truth where the sensor knows it.

    The map starts at the true first pose. In the logs it is scaled by the length of the true path so far over its own, so
    that it lies over the truth. What is drawn and logged of a step goes through `aside`: see `Recorder.aside`.
    """

    def __init__(
        self, parts: Parts, plan: Plan, record: Recorder, show: int, gap: float, aside: Aside = lambda action: action()
    ) -> None:
        if not isinstance(parts.backend, IncrementalBackend):
            raise ConfigError(f"{type(parts.backend).__name__} takes no poses as they come; give backend=gtsam_isam2")
        self._planned = plan.T_world_camera
        first = np.zeros(3) if self._planned is None else vectors(self._planned[:1], planar=True)[0]
        odometries = [parts.odometry, *parts.odometries.values()]
        self.front_end = FrontEnd(odometries, parts.loop_closure.begin(), parts.backend.begin(first), record, gap)
        self.steps: list[MappingStep] = []
        self.keys: list[str] = []
        self.times_ms: list[float] = []
        self.delivered: list[int] = []  # which of the plan's frames came
        self._record, self._aside, self._closures_shown = record, aside, False
        self._true_length = self._mapped_length = np.float64(0.0)  # of the path so far
        self._shown, self._stages = (set(evenly(len(plan), most).tolist()) for most in (show, MAPS))

    @property
    def truth(self) -> Floats | None:
        """The true poses (n, 4, 4) of the images so far, where they are known."""
        return None if self._planned is None else self._planned[self.delivered]

    @property
    def closures(self) -> Ints:
        """Earlier and later node (L, 2) of each loop closure."""
        pairs = [(int(node), here) for here, step in enumerate(self.steps) for node in step.closures.nodes]
        return np.array(pairs, int).reshape(-1, 2)

    def process(self, frame: Frames, rng: np.random.Generator) -> None:
        """Map one more image, a batch of one, and log the step."""
        start = time.perf_counter()
        step = self.front_end.process(frame, rng)
        self.steps.append(step)
        self.keys.append(frame.keys[0])
        self.delivered.append(int(frame.plan_index[0]))
        records = self._records(frame, step)
        self.times_ms.append(1e3 * (time.perf_counter() - start))
        tick = self.tick(len(self.steps) - 1)
        took = Series(np.array(self.times_ms[-1:]), np.array([tick.step]), np.array([tick.stamp_ns]), "ms")

        def log() -> None:
            for path, record in records:
                self._record.log(path, record() if callable(record) else record, tick)
            self._record.log("time/image", took)

        self._aside(log)

    def tick(self, node: int) -> Tick:
        """When a node came."""
        return Tick(node, self.front_end.stamps_ns[node])

    def _records(self, frame: Frames, step: MappingStep) -> list[Drawn]:
        """The robot, warnings and loop closures; now and then the image and the map."""
        node, scale = len(self.steps) - 1, self._scale()
        sentences = [f"image {node}, {frame.keys[0]}: {step.bridged}; its step is bridged"] if step.bridged else []
        drawn: list[Drawn] = [("robot", Pose(self._over_truth(self.front_end.online_poses[-1:], scale)[0]))]
        drawn += [("log", Text(sentence, "WARN")) for sentence in sentences + step.warnings]
        drawn += self._closure_records(step.closures.nodes, scale)
        if self.delivered[-1] in self._shown or node == 0:
            drawn.append(("query/image", Image(frame.images[0])))
            drawn.append(("query/panorama", lambda: Image(draw_matches(frame, step.motion))))
            if frame.T_world_camera is not None:
                drawn.append(("camera", Pose(frame.T_world_camera[0])))
        if node and self.delivered[-1] in self._stages:
            drawn.append(("map", self.map(self.front_end.poses(), scale)))
        return drawn

    def _closure_records(self, nodes: Ints, scale: float) -> list[Drawn]:
        """Lines from the robot to the nodes (K,) it was recognised at; none, once, after they were shown."""
        shown, self._closures_shown = self._closures_shown, len(nodes) > 0
        if not len(nodes):
            return [("closures", NONE)] if shown else []
        online = self.front_end.online_poses
        ends = self._over_truth([*(online[int(i)] for i in nodes), online[-1]], scale)
        edges = np.column_stack([np.arange(len(nodes)), np.full(len(nodes), len(nodes))])
        lines = Graph(ends[:, :3, 3], edges, np.tile(np.array(CLOSURE, np.uint8), (len(nodes), 1)))
        return [("closures", lines)]

    def map(self, poses: Floats, scale: float = 1.0) -> Graph:
        """The graph over poses (n, 3), loop closures in green."""
        return Graph(self._over_truth(list(poses), scale)[:, :3, 3], self.front_end.ends, self.colors)

    @property
    def colors(self) -> Bytes:
        """RGB (E, 3) of the map's edges: green those that close loops."""
        return np.where(self.front_end.loops[:, None], CLOSURE, PATH).astype(np.uint8)

    def _scale(self) -> float:
        """The length of the true path so far over that of the mapped one."""
        if len(self.delivered) > 1 and self._planned is not None:
            online = np.array(self.front_end.online_poses[-2:])
            self._true_length += np.linalg.norm(np.subtract(*self._planned[self.delivered[-2:], :2, 3]))
            self._mapped_length += np.linalg.norm(np.subtract(*online[:, :2]))
        return (
            float(self._true_length / self._mapped_length) if self._true_length > 0 and self._mapped_length > 0 else 1.0
        )

    def _over_truth(self, poses: list[Floats], scale: float) -> Floats:
        """Poses (n, 3) as transforms (n, 4, 4) over the truth: scaled about the first pose, at its height."""
        first = matrices(self.front_end.online_poses[0][None])[0]
        T = matrices(np.array(poses))
        T[:, :3, 3] = first[:3, 3] + scale * (T[:, :3, 3] - first[:3, 3])
        if self._planned is not None:
            T[:, 2, 3] = self._planned[0, 2, 3]
        return T
