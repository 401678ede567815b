"""The results of one shard in a file: what its batches hold, joined, and what it is a share of.

A NumPy archive (.npz, uncompressed): `about`, a JSON text, and the arrays by name. Nothing in it is unpickled.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from omnilab.api import Array, Batch
from omnilab.arrays import read_npz
from omnilab.atomic_files import write_whole
from omnilab.errors import DataError

FILE = "shard.npz"
ABOUT = "about"
FORMAT = "shard of omnilab 1"


@dataclass(frozen=True)
class About:
    """What a part is a share of."""

    shard: str
    first: int  # of its units
    last: int
    count: int  # of the stage's units
    run: str  # the identity of the run that was split
    commit: str | None  # of the source tree; None where omnilab is installed
    format: str = FORMAT


def joined(batches: Iterable[Batch]) -> dict[str, Array]:
    """Batches joined along the first axis of each array, over those that have it."""
    found: dict[str, list[Array]] = {}
    for batch in batches:
        for name, array in batch.items():
            found.setdefault(name, []).append(array)
    return {name: np.concatenate(arrays) for name, arrays in found.items()}


def write_part(folder: Path, about: About, arrays: Batch) -> None:
    """Write a shard's results into its run folder; OSError leaves no half file."""
    content = {ABOUT: np.array(json.dumps(asdict(about))), **arrays}
    write_whole(folder / FILE, lambda out: np.savez(out, allow_pickle=False, **content))


def read_part(folder: Path, wanted: About) -> dict[str, Array]:
    """The arrays of a shard; DataError, in a sentence, if it is damaged or that of another run, commit or division."""
    file = folder / FILE
    try:
        arrays = read_npz(file)
        about = About(**json.loads(str(arrays.pop(ABOUT))))
    except (OSError, ValueError, TypeError, KeyError) as error:
        why = getattr(error, "strerror", None) or error
        raise DataError(
            f"{file} cannot be read ({why}); remove the sweep's folder and give its command anew"
        ) from error
    if wrong := _wrong(about, wanted):
        raise DataError(f"{folder} holds shard {about.shard} {wrong}; it cannot be merged with {wanted.shard} of this run:"
                        " go on with the sweep (omnilab sweep resume), which runs it again, or begin it anew")  # fmt: skip
    return arrays


def _wrong(about: About, wanted: About) -> str | None:
    """How a part differs from the one that is wanted."""
    if about.run != wanted.run:
        return "of a run with other settings, seed, versions or files"
    if about.commit != wanted.commit:
        return f"of commit {_short(about.commit)}, and this is {_short(wanted.commit)}"
    if about != wanted:
        return f"of units {about.first} to {about.last} of {about.count}, not {wanted.first} to {wanted.last} of {wanted.count}"
    return None


def _short(commit: str | None) -> str:
    return "none, an installed omnilab" if commit is None else commit[:10] + ("+changes" if "+" in commit else "")
