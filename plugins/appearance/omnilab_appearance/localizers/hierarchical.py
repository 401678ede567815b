"""Hierarchical localisation: representatives first, then the clusters of the best."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Distance, Estimates, Floats, Ints, Places, Signatures, check_settings, setting
from omnilab.errors import DataError
from omnilab.geometry import heading_of, wrap_angle
from omnilab_appearance.localizers.kept_clusters import key_of, read_owners, write_owners
from omnilab_appearance.localizers.nearest import check_map

BLOCK = 256  # places assigned at once
SAME = 1e-2  # tolerance of distances between the same two signatures, as a share of the largest


class ClusterIndex(NamedTuple):
    """A map in clusters, prepared for search."""

    places: Places
    distance: Distance
    head: Any  # the prepared representatives
    members: Sequence[Ints]  # of each cluster, its places in ascending order
    prepared: Sequence[Any]  # the prepared clusters


@dataclass
class Hierarchical:
    """The most alike place of the `probes` clusters with the most alike representatives, in O(sqrt(P)) for P places.

    Representatives are places drawn at random; every place is assigned to the most alike one by the run's own distance
    (the inverted lists of Sivic and Zisserman, 2003, with images as words). A query is compared with all
    representatives, then with the places of the best clusters, and never with the rest: no distance field comes back.
    With 2 sqrt(P) clusters both comparisons are about as large. Where image distances saturate (`poc_band` beyond some
    0.3 m of a room), representatives must lie closer than that: give more `clusters`.
    `keep` names a file for the clusters: they are found once and read from then on, for the same map, distance and settings.
    """

    clusters: int | None = setting(None, at_least=1)  # representatives; null: 2 sqrt(P)
    probes: int = setting(8, at_least=1)  # clusters searched for a query; all, where there are fewer
    seed: int = setting(0, at_least=0, at_most=2**63 - 1)  # of the representatives
    keep: str | None = setting(None, writes=True)  # .npz file of the clusters; null: they are found anew

    def __post_init__(self) -> None:
        check_settings(self)

    def prepare(self, places: Places, distance: Distance) -> ClusterIndex:
        """Draw representatives, assign every place to one, prepare every cluster."""
        check_map(places, "hierarchical")
        signatures = _bare(places.signatures)
        chosen = self._representatives(len(places))
        head = distance.prepare(signatures[chosen])
        owner = self._owners(signatures, distance, head, chosen)
        sizes = np.bincount(owner, minlength=len(chosen))
        members = np.split(np.argsort(owner, kind="stable"), np.cumsum(sizes)[:-1])
        index = ClusterIndex(places, distance, head, members, [distance.prepare(signatures[own]) for own in members])
        _check_scale(index, chosen)
        return index

    def _owners(self, signatures: Signatures, distance: Distance, head: Any, chosen: Ints) -> Ints:
        """The cluster (P,) of every place: that of the most alike representative, read from `keep` where it was kept."""
        key = key_of(signatures, distance, chosen) if self.keep else ""
        if self.keep and (kept := read_owners(Path(self.keep), key, len(signatures), len(chosen))) is not None:
            return kept
        owner = np.concatenate(
            [distance.match(signatures[b], head).distance.argmin(axis=1) for b in _blocks(len(signatures))]
        )
        owner[chosen] = np.arange(len(chosen))
        if self.keep:
            write_owners(Path(self.keep), key, owner)
        return owner

    def _representatives(self, count: int) -> Ints:
        """Indices of the places, of `count`, that represent a cluster, ascending."""
        clusters = round(2 * count**0.5) if self.clusters is None else self.clusters
        if self.clusters is not None and clusters > count:
            raise DataError(
                f"localizer.clusters={clusters} are more than the map's {count} places; give fewer, or null for 2 sqrt(P)"
            )
        return np.sort(np.random.default_rng(self.seed).choice(count, min(clusters, count), replace=False))

    def locate(self, queries: Signatures, index: ClusterIndex) -> Estimates:
        """Compare with the representatives, then with the clusters of the most alike ones."""
        bare = _bare(queries)
        probed = np.argsort(index.distance.match(bare, index.head).distance, axis=1, kind="stable")[:, : self.probes]
        place = np.zeros(len(queries), int)
        distance = np.full(len(queries), np.inf, np.float32)
        for cluster in np.unique(probed):
            chosen = np.flatnonzero((probed == cluster).any(axis=1))
            found = index.distance.match(bare[chosen], index.prepared[cluster]).distance
            best = found.argmin(axis=1)
            nearest = found[np.arange(len(chosen)), best]
            closer = nearest < distance[chosen]
            place[chosen[closer]] = index.members[cluster][best[closer]]
            distance[chosen[closer]] = nearest[closer]
        assert index.places.T_world_camera is not None
        poses = index.places.T_world_camera[place]
        return Estimates(place, distance, poses[:, :3, 3], _headings(queries, place, index))


def _bare(signatures: Signatures) -> Signatures:
    """Signatures without headings, which are compared with the answered place alone."""
    return Signatures(signatures.place)


def _blocks(count: int) -> Iterator[slice]:
    return (slice(start, start + BLOCK) for start in range(0, count, BLOCK))


def _headings(queries: Signatures, place: Ints, index: ClusterIndex) -> Floats | None:
    """Headings (Q,) of queries localised at places (Q,), if the distance gives rotations."""
    rotations = []
    for q, p in enumerate(place):
        here = index.distance.prepare(index.places.signatures[p : p + 1])
        rotation = index.distance.match(queries[q : q + 1], here).rotation_rad
        if rotation is None:
            return None
        rotations.append(rotation[0, 0])
    assert index.places.T_world_camera is not None
    return wrap_angle(heading_of(index.places.T_world_camera[place]) + np.array(rotations))


def _check_scale(index: ClusterIndex, chosen: Ints) -> None:
    """DataError if distances depend on which places were prepared together: clusters would not be on one scale."""
    representatives = _bare(index.places.signatures)[chosen]
    first = np.searchsorted(index.members[0], chosen[0])
    together = index.distance.match(representatives, index.head).distance[:, 0]
    apart = index.distance.match(representatives, index.prepared[0]).distance[:, first]
    if not np.allclose(together, apart, rtol=SAME, atol=SAME * float(together.max())):
        raise DataError(
            "the distance learns its scale from the whole map, and clusters would each have their own; choose another"
            " distance, or localizer=nearest"
        )
