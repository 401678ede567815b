"""The appearances of places: a map whose places have one signature or more, and a day's estimates in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Distance, Estimates, Floats, Ints, Places, Signatures
from omnilab.errors import ConfigError
from omnilab.geometry import heading_of, wrap_angle
from omnilab_studies.common.methods import joined_signatures

FIRST = -1  # the origin of what was described on the first day
ROUNDING = 1e-5  # below zero, of distances


@dataclass(frozen=True)
class Appearances:
    """A signatures of P <= A places, oldest first."""

    signatures: Signatures  # (A, ...)
    place: Ints  # (A,) of which place
    heading_rad: (
        Floats  # (A,) of the camera, world frame: as known on the first day, as estimated later; NaN: not known
    )
    matched_day: Ints  # (A,) when it was last matched, or taken
    origin: Ints  # (A,) the number of the query that it was, or FIRST

    def __len__(self) -> int:
        return len(self.place)

    def at(self, rows: Ints) -> Appearances:
        """Some of them."""
        return Appearances(
            self.signatures[rows], self.place[rows], self.heading_rad[rows], self.matched_day[rows], self.origin[rows]
        )


def of_first_day(places: Places, T_world_camera: Floats) -> Appearances:
    """One appearance a place: the map as it was made, from poses (P, 4, 4)."""
    count = len(places)
    headings = np.asarray(heading_of(T_world_camera), float)
    return Appearances(
        places.signatures, np.arange(count), headings, np.zeros(count, int), np.full(count, FIRST)
    )  # fmt: skip


def joined(one: Appearances, other: Appearances) -> Appearances:
    """Both, in this order."""
    return Appearances(
        joined_signatures([one.signatures, other.signatures]),
        *(
            np.concatenate([getattr(one, name), getattr(other, name)])
            for name in ("place", "heading_rad", "matched_day", "origin")
        ),
    )


@dataclass(frozen=True)
class DayEstimates:
    """What a robot knows of a day's Q queries: what they look like, and which place it takes each for."""

    signatures: Signatures  # (Q, ...)
    row: Ints  # (Q,) the appearance that matched
    place: Ints  # (Q,) the place of that
    heading_rad: Floats  # (Q,) estimated; NaN: not known
    ratio: Floats  # (Q,) in [0, 1], smaller is surer: distance to the place over that to the best place elsewhere
    origin: Ints  # (Q,) their numbers

    def appearances(self, chosen: Ints, day: int) -> Appearances:
        """Some queries as appearances of the places that they were taken for."""
        return Appearances(
            self.signatures[chosen], self.place[chosen], self.heading_rad[chosen], np.full(len(chosen), day),
            self.origin[chosen],
        )  # fmt: skip


def surest(estimates: DayEstimates, sure_ratio: float) -> Ints:
    """Of each place that was recognised with a ratio of `sure_ratio` or less, the surest query (of equals the first)."""
    order = np.argsort(estimates.ratio, kind="stable")
    order = order[estimates.ratio[order] <= sure_ratio]
    _, first = np.unique(estimates.place[order], return_index=True)
    return order[first]


class AppearanceIndex:
    """A map made ready for queries. An estimate is as sure as the best place elsewhere is unlike the query.

    That ratio is Lowe's (2004, 7.1) with the neighbours of the estimated place, nearer than `apart_m`, left out: they
    look nearly the same without being wrong.
    """

    def __init__(self, known: Appearances, places_m: Floats, distance: Distance, apart_m: float) -> None:
        self._known, self._places_m, self._distance, self._apart_m = known, places_m, distance, apart_m
        self._prepared = distance.prepare(known.signatures)
        self._order = np.argsort(known.place, kind="stable")
        self._starts = np.searchsorted(known.place[self._order], np.arange(len(places_m)))

    def locate(self, queries: Signatures, origin: Ints) -> tuple[DayEstimates, Estimates]:
        """What the robot knows of queries with these numbers, and the same as a localizer's estimates.

        ConfigError for distances below zero, of which no ratio can be taken.
        """
        match = self._distance.match(queries, self._prepared)
        row = match.distance.argmin(axis=1)
        every = np.arange(len(row))
        place, best = self._known.place[row], match.distance[every, row]
        if (best < -ROUNDING).any():
            raise ConfigError(
                f"the distance gives {best.min():.3g}, and lifelong_map compares ratios of distances, which are none below 0;"
                " choose another, such as circular_correlation or cityblock"
            )
        field = np.minimum.reduceat(match.distance[:, self._order], self._starts, axis=1)  # (Q, P)
        heading = np.full(len(row), np.nan)
        if match.rotation_rad is not None:
            heading = wrap_angle(self._known.heading_rad[row] + match.rotation_rad[every, row])
        ratio = self._ratio(field, place, best)
        known = DayEstimates(queries, row, place, heading, ratio, origin)
        headings = None if match.rotation_rad is None else heading
        return known, Estimates(place, best, self._places_m[place], headings, field)

    def _ratio(self, field: Floats, place: Ints, best: Floats) -> Floats:
        """The ratio (Q,) of each estimate; 1 where nothing is elsewhere, or no place is unlike."""
        away_m = np.linalg.norm(self._places_m[place][:, None] - self._places_m[None], axis=-1)
        elsewhere = np.where(away_m > self._apart_m, field, np.inf).min(axis=1)
        known = (elsewhere > 0) & np.isfinite(elsewhere)
        return np.where(known, np.clip(best / np.where(known, elsewhere, 1), 0, 1), 1.0)


def joined_days(batches: list[DayEstimates]) -> DayEstimates:
    """Batches of a day's queries, in order."""
    names = ("row", "place", "heading_rad", "ratio", "origin")
    return DayEstimates(
        joined_signatures([batch.signatures for batch in batches]),
        *(np.concatenate([getattr(batch, name) for batch in batches]) for name in names),
    )
