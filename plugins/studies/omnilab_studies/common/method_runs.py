"""Methods under comparison on one map: the same queries localised by each, with time and memory."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from omnilab.api import Descriptor, Estimates, Frames, Parts, Places, Plan, Recorder, Signatures
from omnilab.metrics import spacing
from omnilab_studies.common.describing import describe, describe_places, fitted
from omnilab_studies.common.methods import Method, descriptors_of, methods_of
from omnilab_studies.common.scores import Degeneracy, ScoredEstimates, known_poses, score


class MethodEstimates(NamedTuple):
    """One method's estimates for a batch of queries."""

    method: Method
    signatures: Signatures
    estimates: Estimates
    scored: ScoredEstimates


class MethodCost(NamedTuple):
    """Cost of a method: bytes of a place, and milliseconds to describe and to localise one query."""

    bytes_per_place: float
    describe_ms: float
    locate_ms: float

    @property
    def query_ms(self) -> float:
        """Milliseconds of a query in all."""
        return self.describe_ms + self.locate_ms


class MethodRuns:
    """The methods of a run, each with its map of the planned places. A descriptor describes each image once."""

    def __init__(self, parts: Parts, plan: Plan, record: Recorder) -> None:
        self.methods = methods_of(parts)
        self._localizer, self._record = parts.localizer, record
        self._descriptors: dict[str, Descriptor] = {}
        self._places: dict[str, Places] = {}
        self._degeneracies: dict[str, Degeneracy] = {}
        self._spent: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])  # seconds and queries of each stage
        for name, descriptor in descriptors_of(self.methods).items():
            own = fitted(replace(parts, descriptor=descriptor), plan, record)
            self._descriptors[name] = own.descriptor
            self._places[name], _ = describe_places(own, plan, record, f"places, {name}")
            self._degeneracies[name] = Degeneracy(self._places[name], name)
            self._degeneracies[name].log_map(record)
        self._step_m = spacing(known_poses(plan.T_world_camera, "places")[:, :3, 3])
        self._maps: dict[str, Any] = {
            m.name: self._localizer.prepare(self._places[m.descriptor_name], m.distance) for m in self.methods
        }

    def localize(self, frames: Frames) -> Iterator[MethodEstimates]:
        """Every method's estimates for a batch of queries, scored."""
        yield from self.localize_by(list(self._descriptors), frames)

    def localize_by(self, descriptor_names: list[str], frames: Frames) -> Iterator[MethodEstimates]:
        """The same, by the methods of some descriptors alone."""
        for name in descriptor_names:
            start = time.perf_counter()
            signatures = describe(self._descriptors[name], frames, self._record)
            self._spend(name, start, frames)
            places_m = known_poses(self._places[name].T_world_camera, "places")[:, :3, 3]
            for method in (m for m in self.methods if m.descriptor_name == name):
                start = time.perf_counter()
                with self._record.timed("localise", len(frames)):
                    estimates = self._localizer.locate(signatures, self._maps[method.name])
                self._spend(f"locate {method.name}", start, frames)
                degeneracy = self._degeneracies[name]
                scored = score(frames, estimates, places_m, self._step_m, degeneracy.alike)
                degeneracy.add(signatures, scored)
                yield MethodEstimates(method, signatures, estimates, scored)

    def log_degeneracy(self) -> None:
        """Warnings of what is degenerate in all queries so far, into the logs."""
        for degeneracy in self._degeneracies.values():
            degeneracy.log_queries(self._record)

    def cost(self, method: Method) -> MethodCost:
        """The cost of a method, averaged over its queries so far."""
        places = self._places[method.descriptor_name]
        return MethodCost(
            places.signatures.nbytes / len(places),
            self._each_ms(method.descriptor_name),
            self._each_ms(f"locate {method.name}"),
        )

    def _spend(self, stage: str, start: float, frames: Frames) -> None:
        self._spent[stage][0] += time.perf_counter() - start
        self._spent[stage][1] += len(frames)

    def _each_ms(self, stage: str) -> float:
        seconds, count = self._spent[stage]
        return 1e3 * seconds / max(count, 1)
