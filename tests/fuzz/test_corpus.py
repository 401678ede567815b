"""What fuzzing found, made again: a row is a format, what replaces what in a sound file, and what is said of it."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fuzz_formats import FORMATS

from omnilab.errors import DataError
from omnilab.trajectory.files import read_trajectory

Change = Callable[[bytes], bytes]


def put(old: bytes, new: bytes) -> Change:
    def change(data: bytes) -> bytes:
        assert old in data
        return data.replace(old, new, 1)

    return change


def flip(at: int) -> Change:
    return lambda data: data[:at] + bytes([data[at] ^ 64]) + data[at + 1 :]


def cut(at: int) -> Change:
    return lambda data: data[:at]


def member(name: str, array: np.ndarray) -> Change:
    """Another array in an archive, whose checksums are right."""

    def change(data: bytes) -> bytes:
        with np.load(io.BytesIO(data)) as archive:
            arrays = dict(archive) | {name: array}
        out = io.BytesIO()
        np.savez(out, **arrays)
        return out.getvalue()

    return change


def compressed(data: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        for info in old.infolist():
            new.writestr(info.filename, old.read(info))
    return out.getvalue()


FOUND: list[tuple[str, Change, str]] = [
    ("basis_npz", flip(0), "it is no whole archive of arrays"),
    ("basis_npz", cut(900), "it is no whole archive of arrays"),
    ("basis_npz", flip(200), "it is no whole archive of arrays"),
    ("basis_npz", compressed, "is compressed, or larger than the file"),
    ("basis_npz", member("singular", np.full(3, np.nan)), "holds NaN, infinity or other types"),
    ("basis_npz", member("vectors", np.array([["a"]])), "holds arrays that do not fit together"),
    ("basis_npz", member("frequencies", np.array([0, 1, 99])), "frequencies that no rotations have"),
    ("map_npz", member("place", np.zeros((4, 3), object)), "place: it is no array|place: it claims"),
    ("map_npz", member("T_world_camera", np.tile(np.eye(4) * 2, (4, 1, 1))), "holds other matrices than poses"),
    (
        "map_npz",
        member("keys", np.array([0x110000] * 4, np.uint32).view("<U1")),
        "keys: it holds characters that do not exist",
    ),
    ("map_npz", member("keys", np.zeros(4, np.dtype("<U1"))[:0].astype("<U0")), "keys"),
    ("depth_npy", put(b"'fortran_order': False", b"'fortran_order': Falze"), "it is no array of NumPy's format 1.0"),
    ("depth_npy", put(b"(32, 32)", b"(32, 32 "), "it is no array of NumPy's format 1.0"),
    ("depth_npy", put(np.float32(1.5).tobytes(), np.float32(-1.5).tobytes()), "it holds depths below 0"),
    ("camera_unified", put(b'"k1": 0.0', b'"k1": 4294967296'), "see"),
    ("scenario_yaml", put(b"step_m: ", b"step_m: &a 0.5\nstep_n: *a # "), "is an alias; write the value out"),
    ("run_metrics.csv", put(b"unit,low,high", b"unit,low,note"), "it has a column low, and none that is called high"),
    ("run_config.yaml", put(b"seed: 0", b"seed: &a 0\nlogs: *a"), "it has an alias"),
]


@pytest.mark.parametrize(
    ("name", "change", "told"), FOUND, ids=[f"{i}: {name}" for i, (name, _, _) in enumerate(FOUND)]
)
def test_a_file_that_was_a_traceback_is_one_sentence(name: str, change: Change, told: str, tmp_path: Path) -> None:
    how = FORMATS[name.partition(".")[0]]
    folder = tmp_path / "input"
    file = folder / how.file
    sound = how.prepare(folder)
    file.write_bytes(change(sound))
    with pytest.raises(DataError, match=told) as error:
        how.read(folder)
    assert "\n" not in str(error.value)


def test_a_matrix_of_four_digits_becomes_the_nearest_rotation(tmp_path: Path) -> None:
    how = FORMATS["poses_kitti"]
    sound = how.prepare(tmp_path / "input")
    exact = read_trajectory(tmp_path / "input" / how.file).T_world_camera
    rows = [" ".join(f"{float(word):.4f}" for word in line.split()) for line in sound.decode().splitlines()]
    (tmp_path / "input" / how.file).write_text("\n".join(rows) + "\n")
    how.read(tmp_path / "input")  # which takes rotations alone
    np.testing.assert_allclose(read_trajectory(tmp_path / "input" / how.file).T_world_camera, exact, atol=2e-4)
