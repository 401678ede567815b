"""The methods that a study compares: descriptors with distances."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Descriptor, Distance, Frames, Parts, Plan, Recorder, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.limits import check_work
from omnilab_studies.common.describing import describe, fitted
from omnilab_studies.common.samples import evenly

PROBES = 8  # signatures on which a distance is tried


class Method(NamedTuple):
    """A descriptor with a distance, under a name of its own."""

    name: str  # descriptor, or descriptor + distance where there are several distances
    descriptor_name: str
    descriptor: Descriptor
    distance: Distance
    distance_name: str


def key_of(name: str) -> str:
    """A method's name as a part of metric names and log paths."""
    return name.replace(" + ", "_")


def methods_of(parts: Parts) -> list[Method]:
    """Every one of `descriptors` with every one of `distances`, or with its own distance where none are given.

    A distance with the name of a descriptor is for that one alone. Without `descriptors` it is the run's one descriptor
    with its distance.
    """
    if not parts.descriptors:
        if parts.descriptor is None:
            raise ConfigError(
                "the study compares descriptors, and none is chosen; give descriptor=NAME, or several with"
                " +descriptor@descriptors.ANY=NAME"
            )
        return [Method("descriptor", "descriptor", parts.descriptor, parts.distance, "distance")]
    shared = {m: distance for m, distance in parts.distances.items() if m not in parts.descriptors}
    found = []
    for n, descriptor in parts.descriptors.items():
        if n in parts.distances or not shared:
            own = parts.distances.get(n, parts.default_distances[n])
            found.append(Method(n, n, descriptor, own, n if n in parts.distances else descriptor.default_distance))
            continue
        found += [Method(f"{n} + {m}" if len(shared) > 1 else n, n, descriptor, d, m) for m, d in shared.items()]
    return found


def descriptors_of(methods: Iterable[Method]) -> dict[str, Descriptor]:
    """The descriptors of methods, each once, by name."""
    return {method.descriptor_name: method.descriptor for method in methods}


def settings_of(component: Any) -> str:
    """A component's numbers, as NAME=VALUE; a trained one keeps those it had in `settings`."""
    if not is_dataclass(component):
        return ""
    values = {f.name: getattr(component, f.name) for f in fields(component)}
    if "settings" in values:
        return settings_of(values["settings"])
    return " ".join(f"{name}={value}" for name, value in values.items() if isinstance(value, int | float | str))


def fitted_all(parts: Parts, plan: Plan, record: Recorder) -> Parts:
    """The parts with all descriptors able to describe: trainable ones are trained on the plan's frames."""
    own = {name: fitted(replace(parts, descriptor=d), plan, record).descriptor for name, d in parts.descriptors.items()}
    return replace(fitted(parts, plan, record), descriptors=own)


def describe_all(methods: Iterable[Method], frames: Frames, record: Recorder) -> dict[str, Signatures]:
    """Signatures of frames by every method's descriptor, each described once and timed on its own."""
    described = {}
    for name, descriptor in descriptors_of(methods).items():
        with record.timed(f"describe: {name}", len(frames)):
            described[name] = describe(descriptor, frames, record)
    return described


def joined_signatures(batches: Sequence[Signatures]) -> Signatures:
    """Batches of signatures by one descriptor, concatenated."""
    headings = [batch.heading for batch in batches if batch.heading is not None]
    return Signatures(
        np.concatenate([batch.place for batch in batches]), np.concatenate(headings) if headings else None
    )


def check_comparisons(queries: int, places: int) -> None:
    """ConfigError if the distances of all queries to all places do not fit into memory."""
    check_work(
        f"the distances of {queries} images to {places}",
        "give fewer queries, or fewer places (a larger step, a smaller area)",
        memory=4 * queries * places,
    )


def prepared(method: Method, signatures: Signatures, rotated: bool = False) -> Any:
    """The distance's index of signatures; DataError, with the reason, if the distance cannot compare such signatures.

    `rotated`: the images have different headings, which a distance must estimate where rotations shift the signatures.
    """
    index = method.distance.prepare(signatures)
    if method.descriptor.rotation == "invariant" and _is_rotation_invariant(method.distance, signatures):
        raise DataError("the distance looks for turns along the last axis, which a turn of the camera does not shift")
    if (
        rotated
        and method.descriptor.rotation == "equivariant"
        and not _is_rotation_invariant(method.distance, signatures, 0.25)
    ):
        raise DataError(
            "the camera turns between images, which shifts the signatures, and the distance does not look for it"
        )
    return index


def _is_rotation_invariant(distance: Distance, signatures: Signatures, share: float = 1e-3) -> bool:
    """Whether signatures shifted by a quarter of their last axis stay within a share of the median distance."""
    some = signatures[evenly(len(signatures), PROBES)]
    shifted = np.roll(some.place, max(1, some.place.shape[-1] // 4), axis=-1)
    moved = [not np.allclose(*pair) for pair in zip(shifted, some.place, strict=True)]
    found = distance.match(Signatures(shifted, some.heading), distance.prepare(some)).distance
    return any(moved) and bool((found.diagonal()[moved] < share * np.median(found)).all())
