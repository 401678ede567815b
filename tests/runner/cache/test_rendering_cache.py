"""Renderings on disk: the same bits as without them, by all that is in an image, and within their bounds."""

from __future__ import annotations

import os
import pickle
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import omnilab.runner.cache.disk_cache as cache_module
import omnilab.runner.cache.row_store as store_module
from omnilab.api import Plan, RandomPoses, Renderer
from omnilab.runner.cache.kept_methods import KeptRenderings
from omnilab.runner.fingerprint import fingerprint
from omnilab_mirror import Conical, Mirror

WORLD = """\
map_m: [2, 2]
texels_per_m: 8
light:
  ambient: 0.5
  lamps:
    - {at: [0.5, 0, 2.5], power: 1, reach_m: 2}
textures:
  boards: {kind: image, file: boards.png}
variants:
  dark: {light: {ambient: 0.25}}
objects:
  - {kind: room, size: [4, 4, 3], floor: boards}
  - {kind: mesh, file: wedge.obj, at: [0.8, 0.8]}
"""
FACES_ALONE = WORLD[: WORLD.index("  - {kind: mesh")]
WEDGE = "v 0 0 0\nv 0.4 0 0\nv 0 0.4 0\nv 0 0 1.5\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
COUNT = 6
SMALL = {"size": 16, "samples": 1}


@pytest.fixture
def world(tmp_path):
    """The path of a world file with a picture and a mesh."""
    Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3)).save(tmp_path / "boards.png")
    (tmp_path / "wedge.obj").write_text(WEDGE)
    (tmp_path / "world.yaml").write_text(WORLD)
    return str(tmp_path / "world.yaml")


@pytest.fixture
def seen(cache):
    """`seen(sensor, plan)`: the images that a run of its own hands over, their depths, and how many it rendered."""

    def seen(sensor, plan=None, **settings):
        store = cache(**settings)
        wrapped = store.wrap(sensor)
        batches = list(wrapped.frames(sensor.plan(RandomPoses(COUNT, seed=1)) if plan is None else plan))
        depth = [batch.depth_m for batch in batches if batch.depth_m is not None]
        images = np.concatenate([batch.images for batch in batches])
        assert store.found["render"] + store.made["render"] == len(images)
        return images, np.concatenate(depth) if depth else None, store.made["render"]

    return seen


def without(sensor, plan):
    """The images that the sensor itself hands over."""
    return np.concatenate([batch.images for batch in sensor.frames(plan)])


@pytest.mark.parametrize("kind", [Mirror, Conical])
@pytest.mark.parametrize("text", [WORLD, FACES_ALONE], ids=["mesh", "faces"])
def test_images_and_depths_are_the_same_cold_warm_and_without(world, seen, kind, text, tmp_path):
    (tmp_path / "world.yaml").write_text(text)
    sensor = kind(world=world, color=True, depth=True, batch=4, size=16, samples=4, crop=1.0)
    plan = sensor.plan(RandomPoses(COUNT, seed=1))
    (cold, cold_depth, made), (warm, warm_depth, again) = seen(sensor, plan), seen(sensor, plan)
    assert (made, again) == (COUNT, 0)
    assert cold.tobytes() == warm.tobytes() == without(sensor, plan).tobytes()
    assert cold_depth.tobytes() == warm_depth.tobytes()
    assert np.isinf(warm_depth).any()  # where the mirror ends
    order = [4, 1, 4, 0]
    some, depth, made = seen(sensor, plan.at(order))
    assert made == 0
    assert some.tobytes() == cold[order].tobytes()
    assert depth.tobytes() == cold_depth[order].tobytes()


def test_only_poses_that_are_new_are_rendered_and_come_out_as_in_one_batch(world, seen):
    sensor = Mirror(world=world, **SMALL)
    plan = sensor.plan(RandomPoses(40, seed=2))
    assert seen(sensor, plan.at(range(0, 40, 3)))[2] == 14
    images, _, made = seen(sensor, plan)
    assert made == 26
    assert images.tobytes() == without(sensor, plan).tobytes()


def edit(folder, name, old, new):
    """Change a file so that neither its size nor its time say so."""
    path = folder / name
    stat, content = path.stat(), path.read_bytes()
    assert content.count(old) >= 1
    assert len(old) == len(new)
    path.write_bytes(content.replace(old, new, 1))
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns + 1))


@pytest.mark.parametrize(
    "change",
    [
        lambda folder: edit(folder, "world.yaml", b"ambient: 0.5", b"ambient: 0.7"),
        lambda folder: edit(folder, "world.yaml", b"at: [0.5, 0", b"at: [0.1, 0"),
        lambda folder: edit(folder, "wedge.obj", b"1.5", b"1.2"),
        lambda folder: Image.new("RGB", (4, 4), (9, 8, 7)).save(folder / "boards.png"),
    ],
    ids=["ambient light", "lamp", "mesh", "picture"],
)
def test_the_worlds_content_is_in_the_key_also_of_files_that_it_names(world, seen, tmp_path, change):
    sensor = Mirror(world=world, **SMALL)
    before = seen(sensor)[0]
    change(tmp_path)
    after, _, made = seen(sensor)
    assert made == COUNT
    assert not np.array_equal(before, after)
    assert seen(sensor)[2] == 0


@pytest.mark.parametrize(
    "settings",
    [{"variant": "dark"}, {"color": True}, {"samples": 4}, {"size": 18}, {"crop": 0.9}, {"depth": True},
     {"deck_radius_m": 0.3}],
    ids=lambda settings: next(iter(settings)),
)  # fmt: skip
def test_settings_of_light_camera_and_robot_are_in_the_key(world, seen, settings):
    sensor = Mirror(world=world, **SMALL)
    plan = sensor.plan(RandomPoses(COUNT, seed=1))
    assert seen(sensor, plan)[2] == COUNT
    other = replace(sensor, **settings)
    images, depth, made = seen(other, plan)
    assert made == COUNT
    assert images.tobytes() == without(other, plan).tobytes()
    assert (depth is None) is not other.depth


def test_what_a_plan_calls_its_images_does_not_decide(world, seen):
    """Studies image poses of their own under names of their own; each bit of a pose counts."""
    sensor = Mirror(world=world, **SMALL)
    plan = sensor.plan(RandomPoses(COUNT, seed=1))
    assert seen(sensor, plan)[2] == COUNT
    assert seen(sensor, Plan(["one name"] * COUNT, plan.T_world_camera))[2] == 0
    moved = plan.T_world_camera.copy()
    moved[2, 0, 3] = np.nextafter(moved[2, 0, 3], 9)
    moved[3, 2, 0] = -moved[3, 2, 0]  # of 0 its sign
    assert seen(sensor, Plan(plan.keys, moved))[2] == 2


def test_a_world_that_changes_between_plan_and_images_is_not_kept_under_its_old_name(world, seen, tmp_path):
    sensor = Mirror(world=world, **SMALL)
    plan, old = sensor.plan(RandomPoses(COUNT, seed=1)), (tmp_path / "world.yaml").read_bytes()
    edit(tmp_path, "world.yaml", b"ambient: 0.5", b"ambient: 0.7")
    assert seen(sensor, plan)[2] == COUNT
    (tmp_path / "world.yaml").write_bytes(old)
    assert seen(sensor, plan)[2] == COUNT


def test_the_versions_of_all_that_renders_are_in_the_key():
    words = {line.partition(" ")[0] for line in fingerprint(Mirror()).splitlines()}
    assert {"numpy", "numba", "embreex", "opencv-python-headless", "pillow", "omnilab", "omnilab-mirror"} <= words
    assert "source omnilab_mirror " in fingerprint(Mirror())


@pytest.mark.parametrize("part", ["images", "depth_m"])
def test_damaged_images_are_rendered_anew_which_is_said_once(world, seen, tmp_path, caplog, part):
    sensor = Mirror(world=world, depth=True, batch=2, **SMALL)
    images, depth, _ = seen(sensor)
    files = sorted(tmp_path.glob("cache/*/*.npz"))
    assert len(files) == 3
    for file in files[:2]:
        content = bytearray(file.read_bytes())
        content[content.index(f"{part}.npy".encode()) + 200] ^= 1
        file.write_bytes(content)
    again, depth_again, made = seen(sensor)
    assert made == 4
    assert (again.tobytes(), depth_again.tobytes()) == (images.tobytes(), depth.tobytes())
    assert caplog.text.count("is damaged (it is no whole archive of arrays); its images are rendered anew") == 1
    assert seen(sensor)[2] == 0


def test_depths_that_no_camera_measures_are_damage(world, seen, tmp_path, caplog):
    sensor = Mirror(world=world, depth=True, **SMALL)
    seen(sensor)
    (file,) = tmp_path.glob("cache/*/*.npz")
    with np.load(file) as archive:
        arrays = dict(archive)
    arrays["depth_m"][1, 2, 3] = np.nan
    np.savez(file, **arrays)
    assert seen(sensor)[2] == COUNT
    assert "depth_m holds distances below 0, or NaN" in caplog.text


def test_a_run_fills_half_of_the_limit_and_never_throws_away_its_own_images(world, cache, tmp_path, caplog):
    caplog.set_level("INFO", "omnilab")
    sensor = Mirror(world=world, batch=1, size=64, samples=1)
    plan = sensor.plan(RandomPoses(12, seed=1))
    list(cache().wrap(sensor).frames(plan.at([0])))
    (file,) = tmp_path.glob("cache/*/*.npz")
    limit = 10 * file.stat().st_size
    file.unlink()
    for found, made in ((0, 12), (5, 7), (5, 7)):
        store = cache(limit=limit)
        list(store.wrap(sensor).frames(plan))
        assert (store.found["render"], store.made["render"]) == (found, made)
        assert len(list(tmp_path.glob("cache/*/*.npz"))) == 5
    assert "no more images are kept as they are rendered: those of this run are 50% of cache_gb=" in caplog.text


def test_a_disk_that_is_nearly_full_is_left_alone(world, cache, tmp_path, monkeypatch, caplog):
    caplog.set_level("INFO", "omnilab")
    monkeypatch.setattr(
        cache_module.shutil, "disk_usage", lambda _: type("Usage", (), {"free": KeptRenderings.spare_bytes})
    )
    list(cache().wrap(Mirror(world=world, **SMALL)).frames(Mirror(world=world, **SMALL).plan(RandomPoses(2, seed=1))))
    assert not list(tmp_path.glob("cache/*/*"))
    assert "has less than 1 GB left" in caplog.text


def test_large_batches_are_cut_into_files_that_are_read_fast(world, seen, tmp_path, monkeypatch):
    monkeypatch.setattr(store_module, "FILE_BYTES", 2 * 16 * 16)
    sensor = Mirror(world=world, **SMALL)
    images = seen(sensor)[0]
    assert len(list(tmp_path.glob("cache/*/*.npz"))) == 3
    again, _, made = seen(sensor)
    assert made == 0
    assert again.tobytes() == images.tobytes()


def test_a_wrapped_camera_is_one_of_its_class(world, cache):
    sensor = Mirror(world=world, **SMALL)
    wrapped = pickle.loads(pickle.dumps(replace(cache().wrap(sensor), color=True)))
    assert isinstance(wrapped, Mirror | Renderer)
    assert repr(wrapped) == repr(replace(sensor, color=True))
    plan = wrapped.plan(RandomPoses(1, seed=1))
    assert next(wrapped.frames(plan)).images.shape == (1, 16, 16, 3)


def test_an_interrupted_write_leaves_nothing_that_is_read(world, seen, tmp_path, monkeypatch):
    sensor = Mirror(world=world, **SMALL)
    true = store_module.np.savez

    def killed(out, **arrays):
        true(out, **arrays)
        out.truncate(out.tell() // 2)
        raise KeyboardInterrupt

    monkeypatch.setattr(store_module.np, "savez", killed)
    with pytest.raises(KeyboardInterrupt):
        seen(sensor)
    monkeypatch.undo()
    assert not list(tmp_path.glob("cache/*/*.npz"))
    assert seen(sensor)[2] == COUNT
