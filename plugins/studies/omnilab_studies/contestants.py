"""Which descriptors and distances a study compares."""

from __future__ import annotations

from typing import NamedTuple

from omnilab.api import Descriptor, Distance, Parts
from omnilab.errors import ConfigError


class Contestant(NamedTuple):
    """A descriptor with a distance, under a name of its own."""

    name: str  # descriptor, or descriptor + distance where there are several distances
    descriptor_name: str
    descriptor: Descriptor
    distance: Distance


def contestants(parts: Parts) -> list[Contestant]:
    """Every one of `descriptors` with every one of `distances`, or with its own distance where none are given.

    Without `descriptors` it is the run's one descriptor with its distance.
    """
    if not parts.descriptors:
        if parts.descriptor is None:
            raise ConfigError(
                "the study compares descriptors, and none is chosen; give descriptor=NAME, or several with"
                " +descriptor@descriptors.ANY=NAME"
            )
        return [Contestant("descriptor", "descriptor", parts.descriptor, parts.distance)]
    if not parts.distances:
        return [Contestant(n, n, d, parts.default_distances[n]) for n, d in parts.descriptors.items()]
    return [
        Contestant(f"{n} + {m}" if len(parts.distances) > 1 else n, n, descriptor, distance)
        for n, descriptor in parts.descriptors.items()
        for m, distance in parts.distances.items()
    ]
