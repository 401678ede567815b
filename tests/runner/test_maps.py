"""Saved maps: what is written is read back, and what strangers wrote is refused with the reason."""

import io
import json
import zipfile
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import Places, Provenance, Signatures
from omnilab.errors import DataError
from omnilab.geometry import planar_poses
from omnilab.runner.map_file import FILE, about_map, load_places, map_file, save_map

ABOUT = {
    "components": {"descriptor": {"name": "radon"}, "distance": {"name": "poc"}},
    "config": {"descriptor": {"offsets": 8}, "distance": {}},
}


def places(count=5, heading=True, poses=True, learnt=None):
    rng = np.random.default_rng(count)
    signatures = Signatures(
        rng.normal(size=(count, 4, 6)).astype(np.float32),
        rng.normal(size=(count, 3)).astype(np.float32) if heading else None,
    )
    T = planar_poses(rng.normal(size=(count, 3)), rng.normal(size=count)) if poses else None
    return Places(signatures, T, [f"image-{i}.jpg" for i in range(count)], learnt or {})


@pytest.fixture
def file(tmp_path):
    path = tmp_path / FILE
    save_map(path, places(), ABOUT)
    return path


@pytest.mark.parametrize("heading", [True, False])
@pytest.mark.parametrize("poses", [True, False])
def test_a_map_comes_back_bit_for_bit(tmp_path, heading, poses):
    before = places(7, heading, poses, {"mean": np.arange(3) * 1j, "rows": np.array(64)})
    save_map(tmp_path / FILE, before, ABOUT)
    after = load_places(map_file(tmp_path))
    assert np.array_equal(after.signatures.place, before.signatures.place)
    for one, other in (
        (after.signatures.heading, before.signatures.heading),
        (after.T_world_camera, before.T_world_camera),
    ):
        assert (one is None) == (other is None)
        assert one is None or np.array_equal(one, other)
    assert after.keys == before.keys
    assert after.descriptor_state.keys() == before.descriptor_state.keys()
    assert all(np.array_equal(after.descriptor_state[name], value) for name, value in before.descriptor_state.items())
    assert not list(tmp_path.glob("*.part"))


PROVENANCE = Provenance("HyperbolicMirror", 250, 250, (-60.0, 17.5), False, "room", "digest")


@pytest.mark.parametrize("provenance", [None, PROVENANCE, replace(PROVENANCE, elevations_deg=None, world=None)])
def test_what_the_pictures_are_comes_back(tmp_path, provenance):
    save_map(tmp_path / FILE, replace(places(), provenance=provenance), ABOUT)
    assert load_places(tmp_path / FILE).provenance == provenance


def test_numpy_alone_reads_it(file):
    with np.load(file, allow_pickle=False) as archive:
        assert json.loads(archive["about"].item())["version"] == 1
        assert archive["place"].shape == (5, 4, 6)


def test_latest_is_followed_before_it_points_elsewhere(tmp_path, file):
    (tmp_path / "latest").symlink_to(tmp_path)
    assert map_file(tmp_path / "latest") == file.resolve()


def test_no_file(tmp_path):
    with pytest.raises(DataError, match=r"there is no map .*experiment=map"):
        map_file(tmp_path / "nothing.npz")


def rewritten(file, **changed):
    """The archive with some of its arrays replaced, or left out (None)."""
    with np.load(file, allow_pickle=True) as archive:
        arrays = dict(archive) | changed
    np.savez(file, **{name: value for name, value in arrays.items() if value is not None})
    return file


def about(**changed):
    return np.array(json.dumps({"format": "omnilab map", "version": 1, **ABOUT, **changed}))


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"about": about(version=2)}, "version 2 of the format, and this omnilab reads 1"),
        ({"about": about(format="zip")}, "does not say that it is"),
        ({"about": np.array("{")}, "no JSON"),
        ({"about": np.array("[1]")}, "does not say that it is"),
        ({"about": about(components=[])}, "names no components"),
        ({"about": about(config={"descriptor": 3})}, "names no config"),
        ({"about": about(provenance=[])}, "its images' camera is not sound"),
        ({"about": about(provenance={"camera": "a"})}, "its images' camera is not sound"),
        ({"about": about(provenance=asdict(PROVENANCE) | {"width": "wide"})}, "its images' camera is not sound"),
        ({"about": about(provenance=asdict(PROVENANCE) | {"elevations_deg": [1]})}, "its images' camera is not sound"),
        ({"about": None}, "has no about"),
        ({"place": None}, "'place' is missing"),
        ({"keys": None}, "'keys' is missing"),
        ({"place": np.zeros((0, 4, 6), np.float32)}, "no places"),
        ({"place": np.float32(3)}, "no places"),
        ({"place": np.zeros((5, 4, 6))}, "`place` of type float64, not float32"),
        ({"place": np.full((5, 4, 6), np.nan, np.float32)}, "NaN or infinity in `place`"),
        ({"keys": np.array(["one"])}, "keys is"),
        ({"keys": np.arange(5)}, "keys is int64"),
        ({"heading": np.zeros((4, 3), np.float32)}, "`heading` of shape"),
        ({"T_world_camera": np.zeros((5, 3))}, "T_world_camera is"),
        ({"T_world_camera": np.full((5, 4, 4), np.inf)}, "NaN or infinity in `T_world_camera`"),
        ({"learnt.mean": np.array([{"a": 1}], dtype=object)}, "learnt.mean"),
    ],
)  # fmt: skip
def test_what_is_no_sound_map_is_refused_with_the_reason(file, changed, reason):
    with pytest.raises(DataError, match=reason):
        load_places(rewritten(file, **changed))


def test_a_truncated_map(file):
    whole = file.read_bytes()
    for length in (0, 10, len(whole) // 2, len(whole) - 5):
        file.write_bytes(whole[:length])
        with pytest.raises(DataError, match=r"not a map that can be used .*experiment=map"):
            load_places(file)


def test_a_compressed_member_is_refused(file):
    with np.load(file, allow_pickle=False) as archive:
        np.savez_compressed(file, **dict(archive))
    with pytest.raises(DataError, match="compressed"):
        load_places(file)


def test_a_header_that_claims_a_terabyte_takes_no_memory(tmp_path, file):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f4", "fortran_order": False, "shape": (2**38,)})
    with zipfile.ZipFile(file) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in (members | {"place.npy": header.getvalue() + bytes(64)}).items():
            archive.writestr(name, content)
    with pytest.raises(DataError, match="claims 1099511627776 bytes and has 64"):
        load_places(file)


@settings(deadline=None, max_examples=60)
@given(position=st.floats(0, 1), value=st.integers(0, 255))
def test_a_changed_byte_gives_a_map_or_a_sentence(tmp_path_factory, position, value):
    file = tmp_path_factory.mktemp("map") / FILE
    save_map(file, places(), ABOUT)
    content = bytearray(file.read_bytes())
    content[int(position * (len(content) - 1))] = value
    file.write_bytes(content)
    try:
        assert len(load_places(file)) == 5
    except DataError:
        return  # refused; anything else that is raised fails the test


def test_a_disk_that_is_full_leaves_no_half_map(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(OSError, match="No space"):
        save_map(tmp_path / FILE, places(), ABOUT)
    assert list(tmp_path.iterdir()) == []


def test_about_is_what_was_said(file):
    assert about_map(file)["config"]["descriptor"] == {"offsets": 8}
