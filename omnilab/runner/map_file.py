"""Saved maps: described places in one file, with what is needed to describe queries in the same way.

A NumPy archive (.npz, uncompressed): `about`, a JSON text with the format's version and the names, versions and settings
of the components, and by what the images were taken; `keys`, `place`, and where there are such `heading`, `T_world_camera` and `learnt.NAME`. Files may come
from strangers: nothing in them is unpickled or imported, and nothing is read that is larger than the file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np

from omnilab.api import Array, Places, Provenance, Signatures
from omnilab.arrays import read_npz
from omnilab.atomic_files import write_whole
from omnilab.errors import DataError
from omnilab.file_kinds import is_file, is_folder
from omnilab.runner.boundaries import unsound

FILE = "map.npz"
FORMAT, VERSION = "omnilab map", 1
MOST_ABOUT = 1 << 20  # characters
STATE = "learnt."  # before the names of the arrays of a trained descriptor


def save_map(path: Path, places: Places, about: Mapping[str, Any]) -> None:
    """Write places with what is to be known about them; OSError leaves no half file."""
    provenance = None if places.provenance is None else asdict(places.provenance)
    text = json.dumps({"format": FORMAT, "version": VERSION, "provenance": provenance, **about})
    arrays: dict[str, Array] = {"about": np.array(text), "keys": np.array(list(places.keys), dtype=np.str_)}
    arrays["place"] = places.signatures.place
    if places.signatures.heading is not None:
        arrays["heading"] = places.signatures.heading
    if places.T_world_camera is not None:
        arrays["T_world_camera"] = places.T_world_camera
    arrays |= {STATE + name: np.asarray(value) for name, value in places.descriptor_state.items()}
    write_whole(path, lambda out: np.savez(out, allow_pickle=False, **arrays))


def map_file(path: Path) -> Path:
    """The file of a map, which may be named by the folder of the run that made it; DataError if there is none.

    Links are followed now: `latest` will point at the next run.
    """
    file = path / FILE if is_folder(path) else path
    if not is_file(file):
        raise DataError(f"there is no map {file}; make one: omnilab experiment=map")
    return file.resolve()


def about_map(path: Path) -> dict[str, Any]:
    """What a map file says about itself; DataError, with the reason, if it cannot be used."""
    content = _arrays(path, ["about"])["about"]
    if content.nbytes > 4 * MOST_ABOUT or content.dtype.kind != "U":
        raise _unusable(path, f"what it says about itself is no text, or longer than {MOST_ABOUT} characters")
    text = str(content)
    try:
        about = json.loads(text)
    except ValueError as error:
        raise _unusable(path, "what it says about itself is no JSON") from error
    if not isinstance(about, dict) or about.get("format") != FORMAT:
        raise _unusable(path, f"it does not say that it is an {FORMAT}")
    if about.get("version") != VERSION:
        raise _unusable(path, f"it has version {about.get('version')} of the format, and this omnilab reads {VERSION}")
    for part in ("components", "config"):
        if not isinstance(about.get(part), dict) or not all(isinstance(v, dict) for v in about[part].values()):
            raise _unusable(path, f"it names no {part}")
    for slot, used in about["components"].items():
        if not isinstance(used.get("name"), str):
            raise _unusable(path, f"it does not say what its {slot} was")
    files = about.setdefault("files", {})  # of a map of before
    if not isinstance(files, dict) or not all(isinstance(digest, str) for digest in files.values()):
        raise _unusable(path, "its files are no digests")
    return about


def load_places(path: Path) -> Places:
    """The places of a map file; DataError, with the reason, if they are not sound."""
    provenance = _provenance(path, about_map(path))
    arrays = _arrays(path)
    try:
        place, keys = arrays["place"], arrays["keys"]
    except KeyError as error:
        raise _unusable(path, f"{error} is missing") from None
    heading, T = arrays.get("heading"), arrays.get("T_world_camera")
    count = len(place) if place.ndim else 0
    if count == 0:
        raise _unusable(path, "it has no places")
    for name, part, kind, shape in (
        ("keys", keys, np.str_, (count,)), ("T_world_camera", T, np.float64, (count, 4, 4))
    ):  # fmt: skip
        if part is not None and (part.shape != shape or not np.issubdtype(part.dtype, kind)):
            raise _unusable(path, f"{name} is {part.dtype} {part.shape}, which does not fit {count} places")
    if T is not None and np.isfinite(T).all() and not _are_poses(T):
        raise _unusable(path, "T_world_camera holds other matrices than poses")
    state = {name.removeprefix(STATE): value for name, value in arrays.items() if name.startswith(STATE)}
    places = Places(Signatures(place, heading), T, keys.tolist(), state, provenance)
    if wrong := unsound(places):  # as of those that a study returns
        raise _unusable(path, wrong)
    return places


def _provenance(path: Path, about: Mapping[str, Any]) -> Provenance | None:
    """What the images of a map are; None for a map of before such was kept."""
    kept = about.get("provenance")
    if kept is None:
        return None
    kinds: dict[str, tuple[type, ...]] = {
        "camera": (str,), "width": (int,), "height": (int,), "elevations_deg": (list, NoneType), "color": (bool,),
        "world": (str, NoneType), "world_digest": (str, NoneType),
    }  # fmt: skip
    if not isinstance(kept, dict) or not all(name in kept and isinstance(kept[name], kinds[name]) for name in kinds):
        raise _unusable(path, "what it says of its images' camera is not sound")
    degrees = kept["elevations_deg"]
    if degrees is not None and not (len(degrees) == 2 and all(isinstance(d, int | float) for d in degrees)):
        raise _unusable(path, "what it says of its images' camera is not sound")
    elevations = None if degrees is None else (float(degrees[0]), float(degrees[1]))
    return Provenance(**{name: kept[name] for name in kinds} | {"elevations_deg": elevations})


def _are_poses(T: Array) -> bool:
    """Whether matrices (N, 4, 4) are a rotation and a translation each."""
    R = T[:, :3, :3]
    unit = np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max() < 1e-6
    return bool(unit and (np.linalg.det(R) > 0).all() and (T[:, 3] == [0, 0, 0, 1]).all())


def _arrays(path: Path, wanted: list[str] | None = None) -> dict[str, Array]:
    """Arrays of a map, by name; all of them if none are named."""
    try:
        arrays = read_npz(path, wanted)
    except ValueError as error:
        raise _unusable(path, str(error)) from error
    except OSError as error:
        raise DataError(f"the map {path} cannot be read ({error.strerror}); mend that, or give another") from error
    if missing := [name for name in wanted or [] if name not in arrays]:
        raise _unusable(path, f"it has no {missing[0]}")
    return arrays


def _unusable(path: Path, reason: str) -> DataError:
    return DataError(f"{path} is not a map that can be used ({reason}); make one: omnilab experiment=map")
