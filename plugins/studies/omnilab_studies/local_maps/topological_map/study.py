"""Study H: topological maps of whole rooms, from image distances alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Frames,
    GridPoses,
    Parts,
    PathPoses,
    PlaceMap,
    Plan,
    Recorder,
    Report,
    Text,
    Tick,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError, DataError, did_you_mean
from omnilab.geometry import planar_poses, spanned
from omnilab_studies.common.frames import deliver
from omnilab_studies.common.free_area import window
from omnilab_studies.common.logs import show_picture, start_logs
from omnilab_studies.common.methods import Method, fitted_all, methods_of
from omnilab_studies.common.pose_sources import changed
from omnilab_studies.common.scores import known_poses
from omnilab_studies.local_maps.candidates import describe_images
from omnilab_studies.local_maps.display import STATE_NS, settling
from omnilab_studies.local_maps.embedders import embedders_of, warm_up
from omnilab_studies.local_maps.topological_map import figures
from omnilab_studies.local_maps.topological_map.layout import LAYOUT
from omnilab_studies.local_maps.topological_map.lengths import Lengths
from omnilab_studies.local_maps.topological_map.results import (
    TopologicalMapResult,
    best_of_each,
    metrics_of,
    result_table,
    summary_of,
    time_table,
)
from omnilab_studies.local_maps.topological_map.runs import TopologicalMapRuns


@dataclass
class TopologicalMap:
    """Study H: a map of all images of a grid at once (Payá et al., 2016, 3.2, 4.4, figures 12-14).

    Every method measures the distances of all pairs, every localizer embeds them in a plane, and the map is fitted to
    the world (translation, rotation, reflection, scale): the residual is its error. Image distances saturate, so
    that far pairs seem closer than they are. `links` n keeps each image's distances to its n most alike ones and takes
    the shortest paths along those for all others (Isomap: Tenenbaum et al., 2000); 0 takes all distances as they are.
    `conformal` n measures them on each image's own scale before that (C-Isomap), and `combined` averages the distances of
    several methods so scaled. `thresholds` leave springs out beyond a distance (3.2.1), in units of the least that leaves
    the images in one part. With `rooms` each step has a room of its own, as figures 12-14. Positions play no part before
    the fit, but with `slope_m`: then c of eq. 14 is the slope of image distance in the first room, as printed.
    """

    steps_m: list[float] = setting([0.1, 0.3, 0.5], above=0, fewest=1)  # of the grids
    nodes: list[int] = setting([22, 11], at_least=2, at_most=10_000, count=2)  # at most, along x and y
    center_m: list[float] = setting([0.0, 0.0], count=2)  # the grid with the fewest gaps nearest to it
    links: list[int] = setting(
        [0, 8], at_least=0, at_most=1_000_000, fewest=1
    )  # most alike images that count; 0: all of them do
    thresholds: list[float] = setting([], above=0, at_most=1e6)  # 1: the least that leaves all in one part
    conformal: list[int] = setting([], at_least=1, at_most=1_000_000)  # most alike images, which give the scale, too
    combined: list[str] = setting([])  # methods whose conformal distances are averaged, as "radon + cityblock"
    slope_m: float | None = setting(None, above=0)  # metres up to which c is measured; null: localizers' own slope
    rooms: dict[str, Any] = setting({})  # by name, settings of the sensor for each of steps_m; none: one for all
    random_headings: bool = False  # turn the camera at every node; only for sensors that image any pose
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own
    show: int = setting(20, at_least=0)  # images of each grid that go into the logs

    needs: ClassVar[tuple[str, ...]] = ("sensor", "localizers")
    metric_names: ClassVar[tuple[str, ...]] = (
        "best_rms_steps", "best_rms", "best_neighbours_kept", "best_rms_steps_at_STEP_m",
        "best_rms_steps_LENGTHS_at_STEP_m", "rms_steps_METHOD_LENGTHS_LOCALIZER",
        "rms_steps_combined_LENGTHS_LOCALIZER_at_STEP_m", "nodes", "maps", "left_out",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        if self.rooms and len(self.rooms) != len(set(self.steps_m)):
            raise ConfigError(
                f"study.rooms holds {len(self.rooms)} rooms for the {len(set(self.steps_m))} steps of"
                f" study.steps_m={list(self.steps_m)}; give each step one, or none"
            )
        if self.combined and not self.conformal:
            raise ConfigError(
                "study.combined averages conformal distances, and there are none; give study.conformal=[6]"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Describe, compare all with all, embed, fit: for every step, method, kind of lengths and localizer."""
        if parts.disturbances:
            raise ConfigError("topological_map has no queries to disturb; leave disturbance out")
        rooms = self._rooms(parts)
        start_logs(record, LAYOUT, next(iter(rooms.values()))[1].sensor)
        embedders = embedders_of(parts)
        warm_up(embedders.values())
        grids = {step_m: self._grid(own, step_m, rng) for step_m, (_, own) in rooms.items()}
        first = self.steps_m[0]
        methods = methods_of(fitted_all(rooms[first][1], grids[first], record))
        self._check_combined(methods)

        runs = TopologicalMapRuns(
            embedders,
            self._lengths(),
            self.combined,
            self.slope_m,
            self.random_headings,
            int(rng.integers(2**32)),
            record,
        )
        omitted: list[str] = []
        for step_m, grid in grids.items():
            room, own = rooms[step_m]
            frames = deliver(own, grid, record, f"images, {step_m:g} m")
            images = describe_images(methods, self._shown(frames, len(grid), record), len(grid), "images", record)
            runs.run(step_m, room, images, methods)
            omitted += images.omitted
        if not runs.results:
            raise DataError(f"not one map could be made ({runs.unsuited[0]}); choose other distances, or more links")
        _show(runs.results, record)
        return _report(runs, omitted)

    def _rooms(self, parts: Parts) -> dict[float, tuple[str, Parts]]:
        """The room of each step, and the parts with its sensor."""
        steps = dict.fromkeys(self.steps_m)
        if not self.rooms:
            return dict.fromkeys(steps, ("", parts))
        return {
            step_m: (name, replace(parts, sensor=changed(parts.sensor, f"study.rooms.{name}", settings)))
            for step_m, (name, settings) in zip(steps, self.rooms.items(), strict=True)
        }

    def _lengths(self) -> list[Lengths]:
        return [
            *(Lengths(links) for links in dict.fromkeys(self.links)),
            *(Lengths(threshold=threshold) for threshold in dict.fromkeys(self.thresholds)),
            *(Lengths(links, conformal=True) for links in dict.fromkeys(self.conformal)),
        ]

    def _check_combined(self, methods: Sequence[Method]) -> None:
        known = [method.name for method in methods]
        for name in self.combined:
            if name not in known:
                raise ConfigError(
                    f"study.combined names '{name}', which is no method of the run; there is {', '.join(known)}"
                    f"{did_you_mean(name, known)}"
                )

    def _grid(self, parts: Parts, step_m: float, rng: np.random.Generator) -> Plan:
        """The nodes of a step: the part of the sensor's grid that has the fewest gaps."""
        plan = parts.sensor.plan(GridPoses(step_m, height_m=self.height_m))
        at = known_poses(plan.T_world_camera, "images")[:, :3, 3]
        inside = window(at[:, :2], step_m, self.nodes, self.center_m)
        if spanned(at[inside, :2]) < 2:
            raise DataError(
                f"the {len(inside)} images with a step of {step_m:g} m lie on one line, at which a map could be mirrored;"
                " give a smaller step in study.steps_m"
            )
        if not self.random_headings:
            return plan.at(inside)
        return parts.sensor.plan(PathPoses(planar_poses(at[inside], rng.uniform(-np.pi, np.pi, len(inside)))))

    def _shown(self, batches: Iterable[Frames], total: int, record: Recorder) -> Iterator[Frames]:
        """Pass batches on, and log some of their images."""
        every = max(1, -(-total // self.show)) if self.show > 0 else total + 1
        for frames in batches:
            for i in np.flatnonzero((frames.plan_index + 1) % every == 0):
                show_picture(record, frames, int(i), Tick(int(frames.plan_index[i]), int(frames.stamps_ns[i])))
            yield frames


def _show(results: Sequence[TopologicalMapResult], record: Recorder) -> None:
    """Log the best map of every step and method, as it settles."""
    step = 0
    for one in best_of_each(results):
        record.log("truth", PlaceMap(one.position_m), Tick(step, STATE_NS * step))
        record.log("log", Text(one.title), Tick(step, STATE_NS * step))
        for graph in settling(one.embedding, 0, one.length, one.fit, float(one.position_m[0, 2])):
            record.log("map", graph, Tick(step, STATE_NS * step))
            step += 1


def _report(runs: TopologicalMapRuns, omitted: Sequence[str]) -> Report:
    results = runs.results
    return Report(
        metrics_of(results, len(omitted)),
        {"topological_maps": result_table(results), "times": time_table(results)},
        figures.topological_map_figures(results),
        summary=summary_of(results),
        omitted=[*runs.unsuited, *omitted],
    )
