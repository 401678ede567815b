"""A policy with its map over the days: localises, adapts, and is scored against a truth that it does not see."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnilab.api import Bools, Distance, Frames, Places, Signatures
from omnilab.metrics import first_alike, spacing
from omnilab_studies.common.scores import ScoredEstimates, joined_estimates, known_poses, score
from omnilab_studies.localization.lifelong_map.appearances import (
    AppearanceIndex,
    DayEstimates,
    joined_days,
    of_first_day,
)
from omnilab_studies.localization.lifelong_map.policies import Policy


class DayResult(NamedTuple):
    """A day of one policy. A signature is wrong at a place that is not the nearest to where it was taken."""

    scored: ScoredEstimates
    updates: int  # signatures that the map took over
    wrong_updates: int
    signatures: int  # of the map at the end of the day
    wrong_signatures: int


class PolicyRun:
    """One policy's map, from the first day on."""

    def __init__(self, name: str, policy: Policy, places: Places, distance: Distance, apart_steps: float) -> None:
        T_world_camera = known_poses(places.T_world_camera, "places")
        self.name, self.days = name, list[DayResult]()
        self.places_m = T_world_camera[:, :3, 3]
        self.known = of_first_day(places, T_world_camera)
        self._policy, self._distance = policy, distance
        self._step_m = spacing(self.places_m)
        self._apart_m = apart_steps * self._step_m
        self._wrong: Bools = np.zeros(0, bool)  # of all queries so far, by their numbers
        self._batches: list[tuple[DayEstimates, ScoredEstimates]] = []

    def begin_day(self) -> None:
        """Make the map ready for the day's queries."""
        self._index = AppearanceIndex(self.known, self.places_m, self._distance, self._apart_m)
        first = np.unique(self.known.place, return_index=True)[1]
        self._alike = first_alike(self.known.signatures[first])

    def localize(self, frames: Frames, signatures: Signatures) -> None:
        """Localise a batch of the day's queries."""
        done = len(self._wrong) + sum(len(scored.place) for _, scored in self._batches)
        estimates, scorable = self._index.locate(signatures, done + np.arange(len(frames)))
        self._batches.append((estimates, score(frames, scorable, self.places_m, self._step_m, self._alike)))

    def end_day(self, day: int) -> DayResult:
        """Adapt the map by the day's estimates; note what became of it."""
        scored = joined_estimates([scored for _, scored in self._batches])
        estimates = joined_days([estimates for estimates, _ in self._batches])
        before, self._batches = len(self._wrong), []
        self._wrong = np.concatenate([self._wrong, scored.verdict != "nearest"])
        self.known = self._policy.adapt(self.known, estimates, day)
        taken = self.known.origin[self.known.origin >= 0]
        new = taken[taken >= before]
        result = DayResult(
            scored, len(new), int(self._wrong[new].sum()), len(self.known), int(self._wrong[taken].sum())
        )  # fmt: skip
        self.days.append(result)
        return result
