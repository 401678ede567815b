"""Study H: maps of whole rooms from nothing but how unlike images are."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from omnilab.api import (
    Embedder,
    Floats,
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
)
from omnilab.errors import ConfigError, DataError
from omnilab.geometry import planar_poses, spanned
from omnilab_studies.common.frames import deliver
from omnilab_studies.common.free_area import window
from omnilab_studies.common.grids import check_step
from omnilab_studies.common.logs import show_picture
from omnilab_studies.common.methods import Method, fitted_all, methods_of, prepared
from omnilab_studies.common.scores import known_poses
from omnilab_studies.local_maps import figures
from omnilab_studies.local_maps.candidates import Described, described
from omnilab_studies.local_maps.embedders import (
    STATE_NS,
    STATES,
    makers_of,
    pair_distances,
    settling,
    warm_up,
)
from omnilab_studies.local_maps.topological_map.layout import LAYOUT
from omnilab_studies.local_maps.topological_map.results import (
    WholeCase,
    WholeMap,
    best_of_each,
    geodesic,
    metrics_of,
    summary_of,
    table_of,
    times_of,
)


@dataclass
class TopologicalMap:
    """Study H: a map of all images of a grid at once (Payá et al., 2016, 3.2, 4.4, figures 12-14).

    Every method measures the distances of all pairs, every localizer arranges them in a plane, and the map is
    fitted to the world (translation, turn, reflection, scale): the residual is its error. Image distances saturate, so
    that far pairs seem closer than they are. `links` n keeps each image's distances to its n most alike ones and takes
    the shortest paths along those for all others (Isomap: Tenenbaum et al., 2000); 0 takes all distances as they are.
    Positions play no part before the fit.
    """

    steps_m: list[float] = field(default_factory=lambda: [0.1, 0.3, 0.5])  # of the grids
    nodes: list[int] = field(default_factory=lambda: [22, 11])  # at most, along x and y
    center_m: list[float] = field(default_factory=lambda: [0.0, 0.0])  # the grid with the fewest gaps nearest to it
    links: list[int] = field(default_factory=lambda: [0, 8])  # most alike images that count; 0: all of them do
    random_headings: bool = False  # turn the camera at every node; only for sensors that image any pose
    height_m: float | None = None  # of the viewpoint; null: the sensor's own
    show: int = 20  # images of each grid that go into the logs

    needs: ClassVar[tuple[str, ...]] = ("sensor", "localizers")

    def __post_init__(self) -> None:
        for step_m in self.steps_m:
            check_step(step_m)
        if not self.steps_m or not self.links:
            raise ConfigError("study.steps_m and study.links make no map without a value; give one or more of each")
        if len(self.nodes) != 2 or min(self.nodes) < 2:
            raise ConfigError(f"study.nodes={list(self.nodes)} are no grid; give 2 or more along x and along y")
        if len(self.center_m) != 2 or not np.isfinite(self.center_m).all():
            raise ConfigError(f"study.center_m={list(self.center_m)} is no position; give [x, y] in metres")
        if min(self.links) < 0:
            raise ConfigError(
                f"study.links={list(self.links)}: {min(self.links)} link nothing; give 0 for all, or how many"
            )
        if self.show < 0:
            raise ConfigError(f"study.show={self.show} shows nothing; give 0 for no pictures, or how many")

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Describe, compare all with all, arrange, fit: for every step, method, links and localizer."""
        if parts.disturbances:
            raise ConfigError("topological_map has no queries to disturb; leave disturbance out")
        record.log("", LAYOUT)
        if scene := parts.sensor.scene():
            record.log("room", scene)
        makers = makers_of(parts)
        warm_up(makers.values())
        grids = {step_m: self._grid(parts, step_m, rng) for step_m in dict.fromkeys(self.steps_m)}
        methods = methods_of(fitted_all(parts, grids[self.steps_m[0]], record))

        # the maps: of every step, by all
        atlas = _Atlas(makers, self.links, self.random_headings, int(rng.integers(2**32)), record)
        omitted: list[str] = []
        for step_m, grid in grids.items():
            frames = deliver(parts, grid, record, f"images, {step_m:g} m")
            images = described(methods, self._shown(frames, len(grid), record), "images", record)
            atlas.make(step_m, images, methods)
            omitted += images.omitted
        if not atlas.maps:
            raise DataError(f"not one map could be made ({atlas.misfits[0]}); choose other distances, or more links")

        # what it amounts to
        _show(atlas.maps, record)
        record.log("summary", Text(summary_of(atlas.maps), markdown=True))
        for sentence in [*atlas.misfits, *omitted]:
            record.log("log", Text(f"left out: {sentence}"))
        tables = {"topological_maps": table_of(atlas.maps), "times": times_of(atlas.maps)}
        return Report(metrics_of(atlas.maps, len(omitted)), tables, figures.whole_maps(atlas.maps))

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
        """Passes batches on, and logs some of their pictures."""
        every = max(1, -(-total // self.show)) if self.show > 0 else total + 1
        for frames in batches:
            for i in np.flatnonzero((frames.plan_index + 1) % every == 0):
                show_picture(record, frames, int(i), Tick(int(frames.plan_index[i]), int(frames.stamps_ns[i])))
            yield frames


class _Atlas:
    """Maps of whole grids by every method and localizer."""

    def __init__(
        self, makers: Mapping[str, Embedder], links: Sequence[int], turning: bool, seed: int, record: Recorder
    ) -> None:
        self._makers, self._links, self._turning, self._seed, self._record = makers, links, turning, seed, record
        self.maps: list[WholeMap] = []
        self.misfits: list[str] = []

    def make(self, step_m: float, images: Described, methods: Sequence[Method]) -> None:
        """All maps of one step."""
        todo = [(method, links) for method in methods for links in self._links]
        for method, links in self._record.track(todo, f"maps, {step_m:g} m", len(todo), lambda _: 1):
            try:
                pairs = self._pairs(method, images, links)
            except DataError as reason:
                self.misfits.append(f"{method.name}, {step_m:g} m, links {links}: {reason}")
                continue
            for name, maker in self._makers.items():
                start = time.perf_counter()
                with self._record.timed(f"arrange: {name}"):
                    made = maker.embed(pairs[None], np.random.default_rng(self._seed), STATES)
                seconds = time.perf_counter() - start
                case = WholeCase(step_m, method.name, links, name)
                self.maps.append(WholeMap(case, images.position_m, pairs, made, seconds))

    def _pairs(self, method: Method, images: Described, links: int) -> Floats:
        """The distances (n, n) of all images, along links where these are asked for."""
        signatures = images.signatures[method.descriptor_name]
        prepared(method, signatures, self._turning)  # tells what does not go together
        with self._record.timed("compare", len(images.position_m) ** 2):
            pairs = pair_distances(method, signatures)
        return geodesic(pairs, links) if links else pairs


def _show(maps: Sequence[WholeMap], record: Recorder) -> None:
    """The best map of every step and method, as it settles."""
    step = 0
    for one in best_of_each(maps):
        record.log("truth", PlaceMap(one.position_m), Tick(step, STATE_NS * step))
        record.log("log", Text(one.title), Tick(step, STATE_NS * step))
        for graph in settling(one.made, 0, one.length, one.fit, float(one.position_m[0, 2])):
            record.log("map", graph, Tick(step, STATE_NS * step))
            step += 1
