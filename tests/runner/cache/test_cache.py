"""Descriptions on disk: the same bits as without them, and nothing on the disk that can stop a run."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import textwrap
import time
from dataclasses import replace

import numpy as np
import pytest

import omnilab.runner.cache.row_store as store_module
from omnilab.runner.cache import DiskCache
from omnilab.runner.fingerprint import fingerprint

LIMIT = 10**9


def is_same(one, other):
    return (one.place.tobytes(), one.heading.tobytes(), one.place.shape, one.heading.shape) == (
        other.place.tobytes(), other.heading.tobytes(), other.place.shape, other.heading.shape
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------------ the same bits
def test_signatures_are_the_same_cold_warm_and_without(probe, cache, images):
    plain = probe.Rows()
    for taken in (0, 10):
        store = cache()
        assert is_same(store.wrap(plain).describe(images), plain.describe(images))
        assert (store.found["describe"], store.made["describe"]) == (taken, 10 - taken)


def test_only_images_that_are_not_known_are_described_in_one_batch(probe, cache, images):
    cache().wrap(probe.Rows()).describe(images[2:5])
    cache().wrap(probe.Rows()).describe(images[6:8])
    plain, order = probe.Rows(), [9, 3, 0, 7, 3, 2, 1, 6, 5, 4, 8]
    store = cache()
    found = store.wrap(plain).describe(images[order])
    assert plain.batches == [5]
    assert (store.found["describe"], store.made["describe"]) == (6, 5)
    assert is_same(found, probe.Rows().describe(images[order]))
    cache().wrap(plain).describe(images)
    assert plain.batches == [5]


def test_what_another_process_has_described_meanwhile_is_seen(probe, cache, images):
    plain = probe.Rows()
    early = cache().wrap(plain)
    early.describe(images[:2])
    cache().wrap(probe.Rows()).describe(images[2:])
    early.describe(images[2:])
    assert plain.batches == [2]


def test_what_is_given_back_can_be_changed(probe, cache, images):
    cached = cache().wrap(probe.Rows())
    for _ in range(3):
        found = cached.describe(images)
        assert is_same(found, probe.Rows().describe(images))
        found.place[:] = 0


def test_no_images_have_no_signatures(probe, cache, images):
    assert len(cache().wrap(probe.Rows()).describe(images[:0])) == 0


def test_signatures_in_another_order_in_memory_stay_as_they_are(probe, cache, images):
    """Sums over them could differ in the last bits."""
    for _ in range(2):
        assert cache().wrap(probe.Moody()).describe(images).place.flags.f_contiguous


# -------------------------------------------------------------------------------------- a descriptor like the given one
def test_a_wrapped_descriptor_is_one_of_its_class(probe, cache, images):
    wrapped = cache().wrap(probe.Rows(power=3))
    assert isinstance(wrapped, probe.Rows)
    assert (wrapped.power, wrapped.view, wrapped.color, wrapped.rotation) == (3, "panorama", False, "invariant")
    assert (type(wrapped).__name__, repr(wrapped)) == ("Rows", repr(probe.Rows(power=3)))


@pytest.mark.parametrize("change", ["replace", "set"])
def test_settings_that_a_study_changes_count(probe, cache, images, change):
    wrapped = cache().wrap(probe.Rows())
    wrapped.describe(images)
    if change == "set":
        wrapped.power = 2
    else:
        wrapped = replace(wrapped, power=2)
    assert is_same(wrapped.describe(images), probe.Rows(power=2).describe(images))


def test_a_wrapped_descriptor_survives_pickling(probe, cache, images):
    wrapped = pickle.loads(pickle.dumps(cache().wrap(probe.Rows(power=2))))
    wrapped.describe(images)
    again = pickle.loads(pickle.dumps(wrapped))
    again.batches.clear()
    assert is_same(again.describe(images), probe.Rows(power=2).describe(images))
    assert again.batches == []


@pytest.mark.parametrize("name", ["Taught", "Secret"])
def test_what_learns_and_what_says_so_is_not_kept(probe, cache, name):
    descriptor = getattr(probe, name)()
    assert cache().wrap(descriptor) is descriptor


def test_a_setting_that_names_a_folder_cannot_be_followed(probe, cache, images, tmp_path):
    store = cache()
    store.wrap(probe.Rows(model=str(tmp_path))).describe(images)
    assert (store.found["describe"], store.made["describe"]) == (0, 0)
    assert not (tmp_path / "cache").exists()


def test_a_class_without_a_source_file_is_not_kept(probe, monkeypatch):
    monkeypatch.setattr(sys.modules[probe.__name__], "__spec__", None)
    assert fingerprint(probe.Rows()) is None


# ------------------------------------------------------------------------------------------------- what can go wrong
def flip(content):
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.parametrize(
    "spoil", [flip, lambda c: c[: len(c) // 2], lambda c: b"", lambda c: b"no archive at all", lambda c: c[:-30]],
    ids=["a bit", "half", "empty", "text", "no end"],
)  # fmt: skip
def test_a_damaged_file_counts_as_none_is_said_once_and_written_anew(
    probe, cache, images, tmp_path, caplog, spoil, made_anew
):
    for half in (images[:5], images[5:]):
        cache().wrap(probe.Rows()).describe(half)
    files = sorted(tmp_path.glob("cache/*/*.npz"))
    assert len(files) == 2
    for file in files:
        file.write_bytes(spoil(file.read_bytes()))
    store = cache()
    assert is_same(store.wrap(probe.Rows()).describe(images), probe.Rows().describe(images))
    assert store.made["describe"] == 10
    assert caplog.text.count("is damaged") == 1
    assert made_anew(cache, probe.Rows(), images) == 0


@pytest.mark.parametrize(
    "arrays",
    [
        {"place": np.zeros((10, 12))},
        {"place": np.zeros((3, 12), np.float32)},
        {"keys": np.zeros((10, 3), np.uint8)},
        {"heading": np.array([{}] * 10, dtype=object)},
    ],
    ids=["type", "count", "keys", "objects"],
)
def test_arrays_that_no_cache_writes_count_as_damage(probe, cache, images, tmp_path, caplog, arrays):
    """Objects would have to be unpickled: that never happens."""
    cache().wrap(probe.Rows()).describe(images)
    (file,) = tmp_path.glob("cache/*/*.npz")
    with np.load(file) as stored:
        written = dict(stored)
    np.savez(file, **written | arrays)
    assert is_same(cache().wrap(probe.Rows()).describe(images), probe.Rows().describe(images))
    assert caplog.text.count("is damaged") == 1


def test_a_full_disk_is_said_once_and_the_run_goes_on(probe, cache, images, monkeypatch, caplog, tmp_path):
    def full(out, **arrays):
        out.write(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store_module.np, "savez", full)
    wrapped = cache().wrap(probe.Rows())
    for half in (images[:5], images[5:]):
        assert is_same(wrapped.describe(half), probe.Rows().describe(half))
    assert caplog.text.count("cannot be written (No space left on device)") == 1
    assert [file.name for file in tmp_path.glob("cache/*/*")] == ["about.txt"]


def test_a_file_in_the_place_of_the_folder_costs_the_saving_only(probe, cache, images, tmp_path, caplog):
    (tmp_path / "cache").write_text("mine")
    for _ in range(2):
        assert is_same(cache().wrap(probe.Rows()).describe(images), probe.Rows().describe(images))
    assert "cannot be written" in caplog.text
    assert (tmp_path / "cache").read_text() == "mine"


def test_a_file_that_vanishes_after_it_was_seen_counts_as_none(probe, cache, images, tmp_path):
    wrapped = cache().wrap(probe.Rows())
    wrapped.describe(images)
    (file,) = tmp_path.glob("cache/*/*.npz")
    file.unlink()
    assert is_same(wrapped.describe(images), probe.Rows().describe(images))
    assert file.exists()


def test_what_was_used_longest_ago_goes_first(probe, cache, tmp_path, made_anew):
    batches = np.random.default_rng(1).integers(0, 256, (4, 16, 64, 64), dtype=np.uint8)
    for batch in batches[:3]:
        cache().wrap(probe.Rows()).describe(batch)
    files = {file: file.stat().st_size for file in tmp_path.glob("cache/*/*.npz")}
    size = max(files.values())
    for file in files:
        os.utime(file, (time.time() - 100, time.time() - 100))
    cache().wrap(probe.Rows()).describe(batches[0])  # used again
    cache(limit=int(3.5 * size)).wrap(probe.Rows()).describe(batches[3])
    left = sum(file.stat().st_size for file in tmp_path.glob("cache/*/*.npz"))
    assert left <= 0.9 * 3.5 * size
    assert [made_anew(cache, probe.Rows(), batch) for batch in (batches[0], batches[3])] == [0, 0]


def test_what_a_dead_writer_left_goes_when_room_is_made(probe, cache, images, tmp_path):
    cache().wrap(probe.Rows()).describe(images[:5])
    (folder,) = (tmp_path / "cache").iterdir()
    old, new = (folder / f"{name:032x}.{name}-{name:08x}.part" for name in (1, 2))
    for part in (old, new):
        part.write_bytes(b"x" * 5000)
    os.utime(old, (time.time() - 7200, time.time() - 7200))
    cache(limit=100).wrap(probe.Rows()).describe(images[5:])
    assert not old.exists()
    assert new.exists(), "someone may still be writing it"


@pytest.mark.parametrize("how", ["beside it", "in a folder of the cache", "named like one of the cache", "a link"])
def test_nothing_of_the_users_is_counted_or_removed(probe, cache, images, tmp_path, how):
    """`cache=DIR` may name a folder that holds other things, also .npz files."""
    cache().wrap(probe.Rows()).describe(images[:5])
    (folder,) = (tmp_path / "cache").iterdir()
    own = set(folder.iterdir())
    mine = {
        "beside it": tmp_path / "cache" / "data" / "precious.npz",
        "in a folder of the cache": folder / "precious.npz",
        "named like one of the cache": tmp_path / "cache" / ("0" * 32) / ("1" * 32 + ".npz"),
        "a link": folder / ("2" * 32 + ".npz"),
    }[how]
    mine.parent.mkdir(exist_ok=True)
    if how == "a link":
        (tmp_path / "precious.npz").write_bytes(b"mine" * 100_000)
        mine.symlink_to(tmp_path / "precious.npz")
    else:
        mine.write_bytes(b"mine" * 100_000)
        (mine.parent / "about.txt").exists() or (mine.parent / "about.txt").write_text("my experiments")
    os.utime(mine, (0, 0))
    cache(limit=300_000).wrap(probe.Rows()).describe(images[5:])
    assert mine.read_bytes() == b"mine" * 100_000
    assert own < set(folder.iterdir()), "the cache itself is within its limit: nothing had to go"


def test_a_folder_whose_text_was_torn_is_taken_up_again(probe, cache, images, tmp_path, made_anew):
    cache().wrap(probe.Rows()).describe(images)
    (about,) = tmp_path.glob("cache/*/about.txt")
    about.write_text("")
    assert made_anew(cache, probe.Rows(), images) == 0
    cache().wrap(probe.Rows()).describe(images[::-1, ::-1])
    assert "threads" in about.read_text()


WRITER = """
    import sys, numpy as np
    from pathlib import Path
    from omnilab.runner.cache import DiskCache
    from omnilab_appearance import TinyImage
    tiny, rng = DiskCache(Path(sys.argv[1]), 10**9, 1).wrap(TinyImage()), np.random.default_rng(5)
    print("ready", flush=True)
    sys.stdin.readline()
    for images in rng.integers(0, 256, (200, 8, 32, 64), dtype=np.uint8):
        tiny.describe(images)
"""


def writer(folder):
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(WRITER), folder],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout.readline() == "ready\n", process.stderr.read()
    return process


@pytest.mark.slow
@pytest.mark.parametrize("end", ["both go on", "one is killed"])
def test_two_processes_write_at_once(tmp_path, caplog, end):
    """Whatever they leave is whole, and right; a killed one leaves at most unfinished files."""
    from omnilab_appearance import TinyImage

    writers = [writer(tmp_path), writer(tmp_path)]
    for one in writers:
        one.stdin.write("go\n")
        one.stdin.flush()
    if end == "one is killed":
        while not any(tmp_path.glob("*/*.npz")):
            time.sleep(0.01)
        writers[0].kill()
    errors = [one.communicate()[1] for one in writers]
    assert errors == ["", ""]
    assert writers[1].returncode == 0
    store = DiskCache(tmp_path, LIMIT, 1)
    for images in np.random.default_rng(5).integers(0, 256, (200, 8, 32, 64), dtype=np.uint8):
        assert np.array_equal(store.wrap(TinyImage()).describe(images).place, TinyImage().describe(images).place)
    assert (store.found["describe"], store.made["describe"]) == (1600, 0)
    assert "damaged" not in caplog.text
