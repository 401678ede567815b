"""Clusters of a map, kept in a file: to find them takes P^1.5 comparisons, to read them none."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Distance, Ints, Signatures
from omnilab.arrays import read_npz
from omnilab.atomic_files import write_whole
from omnilab.errors import DataError

FORMAT = "omnilab clusters 1"


def key_of(signatures: Signatures, distance: Distance, chosen: Ints) -> str:
    """What decides on the clusters: the map's signatures, the distance with its settings, the representatives."""
    cls, place = type(distance), np.ascontiguousarray(signatures.place)
    digest = hashlib.sha256(f"{cls.__module__} {distance!r} {place.dtype} {place.shape}".encode())
    digest.update(place.data)
    digest.update(np.asarray(chosen, np.int64).data)
    return digest.hexdigest()


def read_owners(file: Path, key: str, places: int, clusters: int) -> Ints | None:
    """The cluster (P,) of every place, None where there is no such file; DataError if it holds others than those of `key`."""
    try:
        kept = read_npz(file, ["about", "owner"])
    except FileNotFoundError:
        return None
    except OSError as error:
        raise DataError(
            f"the clusters {file} cannot be read ({error.strerror}); mend that, or name another file"
        ) from error
    except ValueError as error:
        raise _other(file, str(error)) from error
    if (about := str(kept.get("about"))) != f"{FORMAT} {key}":
        ours = about.startswith(FORMAT)
        raise _other(file, "they are of another map, distance, seed or number" if ours else f"it says no {FORMAT!r}")
    owner: Any = kept.get("owner")
    if owner is None or owner.shape != (places,) or owner.dtype != np.int32 or not _within(owner, clusters):
        raise _other(file, f"it does not name one of {clusters} clusters for each of {places} places")
    return np.asarray(owner, np.int64)


def write_owners(file: Path, key: str, owner: Ints) -> None:
    """Keep the cluster (P,) of every place; DataError if it cannot be written."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        about = np.array(f"{FORMAT} {key}")
        write_whole(file, lambda out: np.savez(out, allow_pickle=False, about=about, owner=owner.astype(np.int32)))
    except OSError as error:
        raise DataError(f"the clusters {file} cannot be written ({error.strerror}); give another file") from error


def _within(owner: Ints, clusters: int) -> bool:
    return bool(owner.min() >= 0 and owner.max() < clusters)


def _other(file: Path, reason: str) -> DataError:
    return DataError(f"{file} does not hold the clusters of this map ({reason}); name a file that is not there yet")
