"""Large maps: cost of localizers, and their agreement with exhaustive search."""

from __future__ import annotations

import resource
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from omnilab.api import (
    Answers,
    Floats,
    GridPoses,
    Metric,
    Parts,
    PlaceMap,
    Places,
    Plan,
    RandomPoses,
    Recorder,
    Report,
    Series,
    Signatures,
    Tick,
    check_settings,
    setting,
)
from omnilab.errors import ConfigError
from omnilab_studies.common.describing import check_signatures, describe, describe_places, fitted
from omnilab_studies.common.frames import deliver_queries
from omnilab_studies.common.logs import show_frame, start_logs
from omnilab_studies.common.methods import joined_signatures
from omnilab_studies.common.scores import Degeneracy, known_poses
from omnilab_studies.common.tables import columns_of, markdown
from omnilab_studies.localization.large_map.figures import scaling
from omnilab_studies.localization.large_map.layout import LAYOUT
from omnilab_studies.localization.large_map.search_cost import SearchCost, exponent
from omnilab_studies.localization.large_map.side_by_side import SideBySide, in_worlds

EXHAUSTIVE = "exhaustive"
MAP_NS = 100_000_000  # between two maps, in the logs
Row = dict[str, Any]


@dataclass
class LargeMap:
    """Time, memory and estimates of localizers as the map grows: finer grids, then more worlds.

    The run's `localizer` searches the whole map; every one of its `localizers` is compared with it. `agreement` is the
    share of queries whose two estimates lie within the coarsest of `steps_m`, `same` that of the same place, `recall` that
    of estimates within the coarsest step of where the query was taken. Queries come one at a time; their time is the
    median, without the description, and `compared` are the signatures that one is compared with, which no other load of
    the machine disturbs. Memory is that of the signatures and of the prepared map's arrays beside them. Exponents are
    slopes in the log-log figure. A trainable descriptor is trained on the first map alone.
    """

    steps_m: list[float] = setting([0.2, 0.12, 0.07, 0.04], above=0, fewest=1)  # of the grids in the sensor's world
    worlds: list[str] = field(default_factory=list)  # then added one after the other, at the last step; virtual sensors
    query_count: int = setting(200, at_least=1, at_most=1_000_000)  # random poses, shared out evenly over the worlds
    height_m: float | None = setting(None, at_least=-1e6, at_most=1e6)  # of the viewpoint; null: the sensor's own

    needs: ClassVar[tuple[str, ...]] = ("sensor", "descriptor", "distance", "localizer", "localizers")
    metric_names: ClassVar[tuple[str, ...]] = (
        "places_most", "agreement_least", "same_least", "maps", "queries", "left_out", "bytes_per_place",
        "agreement_LOCALIZER", "same_LOCALIZER", "recall_LOCALIZER", "compared_LOCALIZER",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_settings(self, "study.")
        if self.query_count <= len(self.worlds):
            raise ConfigError(
                f"study.query_count={self.query_count} leaves worlds without a query; give {len(self.worlds) + 1} or more"
            )

    def run(self, parts: Parts, record: Recorder, rng: np.random.Generator) -> Report:
        """Map after map: describe the places, search them by every localizer, compare."""
        if EXHAUSTIVE in parts.localizers:
            raise ConfigError(f"localizers.{EXHAUSTIVE} has the name of the run's own localizer; choose another name")
        worlds = SideBySide.of(in_worlds(parts.sensor, self.worlds), self._grid(self.steps_m[-1]))
        start_logs(record, LAYOUT, worlds)
        parts = fitted(parts, parts.sensor.plan(self._grid(self.steps_m[0])), record)
        rows, left_out = self._search_all(parts, worlds, int(rng.integers(2**32)), record)
        table, growth = columns_of(rows), _growth(rows)
        return Report(
            self._metrics(rows, left_out),
            {"maps": table, "exponents": growth},
            {"scaling": scaling(rows)},
            summary=_summary(table, growth, max(self.steps_m)),
        )

    def _grid(self, step_m: float) -> GridPoses:
        return GridPoses(step_m, height_m=self.height_m)

    def _search_all(self, parts: Parts, worlds: SideBySide, seed: int, record: Recorder) -> tuple[list[Row], int]:
        """Grids of one world, finer and finer, then the last one over more worlds: rows, and how many were left out."""
        rows: list[Row] = []
        left_out = 0
        for i, step_m in enumerate(self.steps_m):
            covered = worlds if i + 1 == len(self.steps_m) else worlds.first(1)
            grid = covered.plan(self._grid(step_m))
            whole, omitted = describe_places(replace(parts, sensor=covered), grid, record, f"{len(grid)} places")
            left_out += len(omitted)
            Degeneracy(whole).log_map(record)
            for count in range(1, len(covered.sensors) + 1):
                some = covered.first(count)
                tick = Tick(i + count - 1, MAP_NS * (i + count - 1))
                found = self._search(replace(parts, sensor=some), some.part_of(whole), seed, tick, record)
                rows += [{"worlds": count, "step_m": step_m, **row} for row in found]
        return rows, left_out

    def _search(self, parts: Parts, places: Places, seed: int, tick: Tick, record: Recorder) -> list[Row]:
        """One row for each localizer on one map."""
        record.log("places", PlaceMap(known_poses(places.T_world_camera, "places")[:, :3, 3]), tick)
        plan = parts.sensor.plan(RandomPoses(self.query_count, seed, height_m=self.height_m))
        queries, truth_m = _queries(parts, plan, record, tick, seed)

        rows: list[Row] = []
        exact: SearchCost | None = None
        for name, localizer in {EXHAUSTIVE: parts.localizer, **parts.localizers}.items():
            with record.timed(f"search: {name}", len(queries)):
                found = SearchCost.by(localizer, parts.distance, places, queries)
            exact = exact or found
            rows.append(_row(name, found, exact, places, truth_m, max(self.steps_m)))
            _show(record, rows[-1], found, exact, truth_m, tick)
        return rows

    def _metrics(self, rows: Sequence[Row], left_out: int) -> list[Metric]:
        """Of the largest map, and the least of all. Times and memory are in the table alone: they differ from run to run."""
        compared = [row for row in rows if row["localizer"] != EXHAUSTIVE]
        last = rows[-len({row["localizer"] for row in rows}) :]
        found = [
            Metric("places_most", rows[-1]["places"], "1"),
            Metric("agreement_least", min(row["agreement"] for row in compared), "1"),
            Metric("same_least", min(row["same"] for row in compared), "1"),
            Metric("maps", len(self.steps_m) + len(self.worlds), "1"),
            Metric("queries", self.query_count, "1"),
            Metric("left_out", left_out, "1"),
            Metric("bytes_per_place", 1e6 * rows[-1]["signatures_mb"] / rows[-1]["places"], "B"),
        ]
        names = ("agreement", "same", "recall", "compared")
        return [*found, *(Metric(f"{name}_{row['localizer']}", row[name], "1") for row in last for name in names)]


def _queries(parts: Parts, plan: Plan, record: Recorder, tick: Tick, seed: int) -> tuple[Signatures, Floats]:
    """Signatures of the disturbed queries, and the positions (Q, 3) where they were taken."""
    signatures, truth_m = [], []
    for frames in deliver_queries(parts, plan, record, seed):
        signatures.append(describe(parts.descriptor, frames, record))
        if len(signatures) == 1:
            check_signatures(signatures[0], len(plan), "queries")
        truth_m.append(known_poses(frames.T_world_camera, "queries")[:, :3, 3])
        if len(truth_m) == 1:
            show_frame(record, frames, 0, signatures[0].place[0], tick)
    return joined_signatures(signatures), np.concatenate(truth_m)


def _row(name: str, found: SearchCost, exact: SearchCost, places: Places, truth_m: Floats, coarse_m: float) -> Row:
    return {
        "places": len(places),
        "localizer": name,
        "query_ms": found.query_ms,
        "compared": found.compared,
        "agreement": found.within(exact, coarse_m),
        "same": found.same(exact),
        "recall": found.recall(truth_m, coarse_m),
        "error_median_m": float(np.median(np.linalg.norm(found.position_m - truth_m, axis=1))),
        "index_mb": found.index_bytes / 1e6,
        "signatures_mb": places.signatures.nbytes / 1e6,
        "prepare_s": found.prepare_s,
        "peak_mb": _peak_mb(),
    }


def _peak_mb() -> float:
    """The most memory that the process has had so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def _show(record: Recorder, row: Row, found: SearchCost, exact: SearchCost, truth_m: Floats, tick: Tick) -> None:
    """The estimates, and one point of each curve."""
    at = np.array([tick.step]), np.array([tick.stamp_ns])
    name = row["localizer"]
    record.log(f"time/{name}", Series(np.array([row["query_ms"]]), *at, "ms"))
    record.log(f"compared/{name}", Series(np.array([row["compared"]]), *at, "1"))
    record.log(f"memory/{name}", Series(np.array([row["index_mb"]]), *at, "MB"))
    if found is exact:
        return
    record.log(f"agreement/{name}", Series(np.array([row["agreement"]]), *at, "1"))
    verdict = np.where(found.place == exact.place, "nearest", "wrong")
    record.log(f"answers/{name}", Answers(truth_m, found.position_m, list(verdict)), tick)


def _growth(rows: Sequence[Row]) -> Mapping[str, Sequence[Any]]:
    """Exponents of the time and the memory of each localizer."""
    names = list(dict.fromkeys(row["localizer"] for row in rows))
    of = {name: [row for row in rows if row["localizer"] == name] for name in names}
    sizes = [row["places"] for row in of[names[0]]]
    return {
        "localizer": names,
        **{
            f"{cost}_exponent": [exponent(sizes, [row[cost] for row in of[name]]) for name in names]
            for cost in ("query_ms", "compared", "index_mb")
        },
    }


def _summary(table: Mapping[str, Sequence[Any]], growth: Mapping[str, Sequence[Any]], coarse_m: float) -> str:
    shown = {name: column for name, column in table.items() if name not in {"signatures_mb", "prepare_s", "peak_mb"}}
    return "\n".join(
        [
            f"## Large maps; agreement and recall within {coarse_m:g} m",
            "",
            markdown(shown),
            "",
            "Cost = a · places^b:",
            "",
            markdown(growth),
        ]
    )
