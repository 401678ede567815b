"""A cache in a folder that others write to as well: what it gives back is what was stored, or is made anew."""

from __future__ import annotations

import os
import shutil

import numpy as np
import pytest

import omnilab.runner.cache.disk_cache as cache_module
from omnilab.runner.cache import DiskCache
from omnilab.runner.cache.kept_methods import KeptDescriptions
from omnilab.runner.cache.row_store import RowStore, own_files
from omnilab_appearance import TinyImage

RNG = np.random.default_rng(0)
IMAGES = RNG.integers(0, 256, (6, 16, 32), np.uint8)
PLACE, HEADING = RNG.random((6, 8, 16), np.float32), RNG.random((6, 3, 4), np.float32)
MADE = {"place": PLACE, "heading": HEADING}
KEYS = KeptDescriptions().keys(None, IMAGES)


class Store(RowStore):
    """One that remembers what was damaged."""

    def __init__(self, folder, about="a descriptor"):
        self.errors = []
        super().__init__(folder, about, KeptDescriptions.parts, lambda file, error: self.errors.append(str(error)))

    @property
    def file(self):
        """Its only file of signatures."""
        (file,) = self.folder.glob("*.npz")
        return file


def stored(folder, about="a descriptor"):
    store = Store(folder, about)
    store.store(KEYS, MADE)
    return store


def loaded(store):
    """What is found, by image: as it was stored, or not at all."""
    room, known = store.load(KEYS)
    for row in known:
        assert room["place"][row].tobytes() == PLACE[row].tobytes()
        assert room["heading"][row].tobytes() == HEADING[row].tobytes()
    return known


def test_all_that_was_stored_is_found(tmp_path):
    stored(tmp_path)
    assert loaded(Store(tmp_path)) == list(range(6))


@pytest.mark.parametrize("share", np.linspace(0, 0.999, 40))
def test_a_flipped_bit_is_found(tmp_path, share):
    file = stored(tmp_path).file
    data = bytearray(file.read_bytes())
    data[int(share * len(data))] ^= 16
    file.write_bytes(data)
    loaded(Store(tmp_path))  # which compares whatever it gives


def test_flipped_bits_of_numbers_are_said(tmp_path):
    file = stored(tmp_path).file
    data = bytearray(file.read_bytes())
    at = data.find(PLACE.tobytes()[:16])
    data[at] ^= 1
    file.write_bytes(data)
    store = Store(tmp_path)
    assert loaded(store) == []
    assert store.errors == ["it is no whole archive of arrays"]
    assert not file.exists()


def test_a_file_of_another_descriptor_is_not_taken(tmp_path):
    """By a link, a wrong copy, or somebody's mistake."""
    one, other = stored(tmp_path, "one"), Store(tmp_path, "other")
    other.folder.mkdir()
    (other.folder / "about.txt").write_text("other")
    shutil.copy(one.file, other.folder / one.file.name)
    assert loaded(other) == []
    assert other.errors == ["it is of other images or of another component"]
    assert not (other.folder / one.file.name).exists()


def test_a_file_under_the_name_of_other_images_is_not_taken(tmp_path):
    store = stored(tmp_path)
    store.file.rename(store.folder / f"{'0' * 32}.npz")
    again = Store(tmp_path)
    assert loaded(again) == []
    assert again.errors == ["it is of other images or of another component"]


@pytest.mark.parametrize(
    "changed",
    [
        {"place": PLACE[:3], "heading": HEADING[:3]},
        {"place": PLACE.astype(np.float64)},
        {"place": np.full_like(PLACE, np.nan)},
        {"heading": HEADING[:2]},
        {"place": np.ones(6, np.float32)},
        {"place": np.float32(1)},
        {"keys": np.zeros((6, 16), np.uint8)},
        {"keys": np.float32(1)},
        {"of": np.float32(1)},
        {"of": np.zeros((1, 16), np.uint8)},
        {"place": np.array([b"x"], object)},
        {"of": None},
        {"place": None},
    ],
    ids=range(13),
)
def test_rows_of_another_kind_are_made_anew(tmp_path, changed):
    file = stored(tmp_path).file
    with np.load(file) as archive:
        arrays = {name: archive[name] for name in archive.files} | changed
    np.savez(file, **{name: array for name, array in arrays.items() if array is not None})
    store = Store(tmp_path)
    assert loaded(store) == []
    assert len(store.errors) == 1


def test_a_file_that_another_has_replaced_since_is_not_taken(tmp_path):
    store = stored(tmp_path)
    with np.load(store.file) as archive:
        arrays = dict(archive)
    for change in (lambda array: array[::-1], lambda array: array[:2]):
        np.savez(store.file, **{name: array if name == "of" else change(array) for name, array in arrays.items()})
        assert loaded(store) == []


def test_a_link_to_elsewhere_is_neither_read_nor_written_nor_emptied(tmp_path):
    elsewhere = stored(tmp_path / "elsewhere")
    before = {path: path.read_bytes() for path in elsewhere.folder.iterdir()}
    cache = tmp_path / "cache"
    cache.mkdir()
    (cache / elsewhere.folder.name).symlink_to(elsewhere.folder)
    store = Store(cache)
    assert loaded(store) == []
    with pytest.raises(OSError, match="is a link"):
        store.store(KEYS, MADE)
    assert list(own_files(cache)) == []
    assert {path: path.read_bytes() for path in elsewhere.folder.iterdir()} == before


def test_the_cache_itself_may_be_a_link(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "cache").symlink_to("disk")
    stored(tmp_path / "cache")
    assert loaded(Store(tmp_path / "cache")) == list(range(6))


@pytest.fixture
def read_only(monkeypatch):
    """As if nothing could be written: also for root, who may."""

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    def start():
        for name in ("utime", "unlink", "mkdir", "replace"):
            monkeypatch.setattr(os, name, refuse)
        true = os.open
        monkeypatch.setattr("io.open", lambda *a, **k: refuse() if "w" in str(a[1:2]) else true_open(*a, **k))
        return true

    true_open = open
    return start


def test_a_cache_that_can_only_be_read_is_used_and_said_once(tmp_path, read_only, caplog):
    descriptor = DiskCache(tmp_path, 10**9, 1).wrap(TinyImage())
    first = descriptor.describe(IMAGES[:4])
    read_only()
    caplog.clear()
    cache = DiskCache(tmp_path, 10**9, 1)
    found = cache.wrap(TinyImage()).describe(IMAGES)
    assert (cache.found["describe"], cache.made["describe"]) == (4, 2)
    assert found.place[:4].tobytes() == first.place.tobytes()
    cache.wrap(TinyImage()).describe(IMAGES)
    warnings = [r.getMessage() for r in caplog.records if r.levelname == "WARNING"]
    assert len(warnings) == 1
    assert "cannot be written (Permission denied), the run goes on" in warnings[0]


def test_a_damaged_file_of_another_user_is_said_once(tmp_path, read_only):
    file = stored(tmp_path).file
    file.write_bytes(file.read_bytes()[:-100])
    read_only()
    store = Store(tmp_path)
    assert loaded(store) == []
    assert loaded(store) == []
    assert len(store.errors) == 1
    assert file.exists()


def test_two_runs_make_room_at_once(tmp_path, monkeypatch):
    """Each file that one of them is about to throw away is gone by then."""
    for number in range(5):
        DiskCache(tmp_path, 10**9, 1).wrap(TinyImage()).describe(IMAGES + np.uint8(number))
    true = cache_module._files

    def then_gone(folder):
        found = list(true(folder))
        for file in found:
            file.path.unlink(missing_ok=True)
        return found

    monkeypatch.setattr(cache_module, "_files", then_gone)
    DiskCache(tmp_path, 1, 1).wrap(TinyImage()).describe(IMAGES + np.uint8(9))
    assert not list(tmp_path.rglob("*.npz"))
