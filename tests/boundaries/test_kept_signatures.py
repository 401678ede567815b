"""Signatures that were kept, in the cache or as a map, are checked like fresh ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from omnilab.api import Places, Signatures
from omnilab.errors import DataError
from omnilab.runner.map_file import load_places, save_map
from omnilab.runner.signature_store import SignatureStore

ABOUT: dict[str, dict[str, str]] = {"components": {}, "config": {}}


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("part", ["place", "heading"])
def test_rows_of_the_cache_that_are_not_finite_are_damage(tmp_path: Path, value: float, part: str) -> None:
    damaged: list[str] = []
    store = SignatureStore(tmp_path, "about", lambda _, error: damaged.append(str(error)))
    arrays = {name: np.ones((2, 3), np.float32) for name in ("place", "heading")}
    arrays[part][1, 2] = value
    keys = [b"a" * 16, b"b" * 16]
    store.store(keys, Signatures(**arrays))
    assert store.load(keys) == (None, [])
    assert damaged == [f"{part} holds NaN or infinity"]


@pytest.mark.parametrize(
    ("place", "heading", "reason"),
    [
        (np.ones(2, np.float32), None, "its signatures hold no numbers"),
        (np.ones((2, 0), np.float32), None, "its signatures hold no numbers"),
        (np.ones((2, 3), np.float32), np.ones(2, np.float32), "its signatures hold no numbers"),
        (np.full((2, 3), np.nan, np.float32), None, "place holds NaN or infinity"),
    ],
)
def test_maps_whose_signatures_are_none_are_refused(
    tmp_path: Path, place: np.ndarray, heading: np.ndarray | None, reason: str
) -> None:
    save_map(tmp_path / "map.npz", Places(Signatures(place, heading), None, ["a", "b"]), ABOUT)
    with pytest.raises(DataError, match=reason):
        load_places(tmp_path / "map.npz")
