"""Signatures that were kept, in the cache or as a map, are checked like fresh ones."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from spoiling import OTHER_SIZE, spoilt

from omnilab.api import Places, Provenance, Signatures
from omnilab.errors import DataError
from omnilab.runner.boundaries import unsound
from omnilab.runner.boundaries.images import signatures
from omnilab.runner.cache.kept_methods import KeptDescriptions
from omnilab.runner.cache.row_store import RowStore
from omnilab.runner.map_file import load_places, save_map

ABOUT: dict[str, dict[str, str]] = {"components": {}, "config": {}}


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("part", ["place", "heading"])
def test_rows_of_the_cache_that_are_not_finite_are_damage(tmp_path: Path, value: float, part: str) -> None:
    damaged: list[str] = []
    store = RowStore(tmp_path, "about", KeptDescriptions.parts, lambda _, error: damaged.append(str(error)))
    arrays = {name: np.ones((2, 3), np.float32) for name in ("place", "heading")}
    arrays[part][1, 2] = value
    keys = [b"a" * 16, b"b" * 16]
    store.store(keys, arrays)
    assert store.load(keys) == (None, [])
    assert damaged == [f"{part} holds NaN or infinity"]


@pytest.mark.parametrize(
    ("place", "heading", "reason"),
    [
        (np.ones(2, np.float32), None, "which holds no numbers per image"),
        (np.ones((2, 0), np.float32), None, "which holds no numbers per image"),
        (np.ones((2, 3), np.float32), np.ones(2, np.float32), "which holds no numbers per image"),
        (np.full((2, 3), np.nan, np.float32), None, "NaN or infinity in `place`"),
    ],
)
def test_maps_whose_signatures_are_none_are_refused(
    tmp_path: Path, place: np.ndarray, heading: np.ndarray | None, reason: str
) -> None:
    save_map(tmp_path / "map.npz", Places(Signatures(place, heading), None, ["a", "b"]), ABOUT)
    with pytest.raises(DataError, match=reason):
        load_places(tmp_path / "map.npz")


# ------------------------------------------------------------------------------------------ files, spoilt in every way
KEYS = [b"a" * 16, b"b" * 16]
ROWS = Signatures(np.ones((2, 3), np.float32), np.ones((2, 2, 5), np.float32))
PROVENANCE = Provenance("mirror", 8, 8, (-10.0, 20.0), False, "room", "0123")
PLACES = Places(ROWS, np.tile(np.eye(4), (2, 1, 1)), ["a", "b"], {"basis": np.eye(2)}, PROVENANCE)


def arrays_of(file: Path) -> dict[str, Any]:
    with np.load(file) as archive:
        return dict(archive)


def spoilt_files(file: Path) -> Iterator[str]:
    """Writes the file again and again, one array spoilt each time: which, and how."""
    sound = arrays_of(file)
    for name, array in sound.items():
        if array.ndim == 0:
            continue
        others = {way: new for way, new in spoilt(array) if type(new) is np.ndarray and new.dtype != object}
        for way, new in others.items():
            np.savez(file, **sound | {name: np.asarray(new)})
            yield f"{name}, {way}"
        np.savez(file, **{other: value for other, value in sound.items() if other != name})
        yield f"{name}, none"
    np.savez(file, **sound)


def test_a_spoilt_file_of_the_cache_is_damage_or_the_same(tmp_path: Path) -> None:
    damaged: list[str] = []
    RowStore(tmp_path, "about", KeptDescriptions.parts, lambda *_: None).store(
        KEYS, {"place": ROWS.place, "heading": ROWS.heading}
    )
    (file,) = tmp_path.rglob("*.npz")
    for way in spoilt_files(file):
        found, known = RowStore(
            tmp_path, "about", KeptDescriptions.parts, lambda _, error: damaged.append(str(error))
        ).load(KEYS)
        if known:
            assert found is not None, way
            assert check_like_fresh(KeptDescriptions().result(found), len(KEYS)), way
            assert way in {
                "heading, none",
                *(f"{name}, {how}" for name in ("place", "heading") for how in OTHER_SIZE),
            }, way
    assert len(damaged) > 30


def check_like_fresh(found: Signatures, count: int) -> bool:
    signatures(found, range(count))
    return True


def test_a_spoilt_map_is_refused_or_sound(tmp_path: Path) -> None:
    file = tmp_path / "map.npz"
    save_map(file, PLACES, ABOUT)
    assert str(load_places(file)) == str(PLACES)
    refused = 0
    for way in spoilt_files(file):
        try:
            found = load_places(file)
        except DataError as error:
            refused += "\n" not in str(error)
        else:
            assert unsound(found) == "", way
    assert refused > 50


@pytest.mark.parametrize("name", ["camera", "width", "height", "elevations_deg", "color", "world", "world_digest"])
@pytest.mark.parametrize(
    "value", ["NaN", "-1e999", "1" + "0" * 400, "[]", "{}", "null", "true", '"\\u0000"', "[NaN, 1]", "-5"]
)
def test_a_spoilt_provenance_is_refused_or_sound(tmp_path: Path, name: str, value: str) -> None:
    file = tmp_path / "map.npz"
    save_map(file, PLACES, ABOUT)
    arrays = arrays_of(file)
    text = json.dumps(json.loads(str(arrays["about"])) | {"provenance": asdict(PROVENANCE) | {name: "HERE"}})
    np.savez(file, **arrays | {"about": np.array(text.replace('"HERE"', value))})
    may_be_null = value == "null" and name in {"elevations_deg", "world", "world_digest"}
    if may_be_null or (value, name) == ("true", "color") or (name in {"width", "height"} and value.startswith("10")):
        assert load_places(file).provenance is not None
    else:
        with pytest.raises(DataError):
            load_places(file)
