"""Whatever a setting or a stranger's file names that is no regular file of a name that can be: one sentence, at once."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from omnilab.api import RecordedPoses
from omnilab.arrays import read_npz
from omnilab.cameras import load_camera
from omnilab.errors import DataError, OmnilabError
from omnilab.posegraph.files import read_graph
from omnilab.runner.map_file import about_map, load_places, map_file
from omnilab.runner.plugin_files import file_of, load_file
from omnilab.runner.run_folder import load_run
from omnilab.trajectory.files import read_trajectory
from omnilab.trajectory.tables import read_table
from omnilab_appearance import Onnx, RotationalPca
from omnilab_mirror.scene.load import load_world
from omnilab_recordings import Folder
from omnilab_studies.view_slam.scenarios import scenario

WORLD = (
    "map_m: [4, 4]\ntextures: {{picture: {{kind: image, file: {0}}}}}\nobjects: [{{kind: floor, texture: picture}}]\n"
)
OBJ = "mtllib {0}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n"
SECONDS = 20  # on a busy machine; what hangs, hangs for ever


def _images(folder: Path, **settings: Any) -> Any:
    images = folder / "images"
    images.mkdir()
    cv2.imwrite(str(images / "a.png"), np.full((8, 16), 7, np.uint8))
    sensor = Folder(path=str(images), **settings)
    return [frames.images for frames in sensor.frames(sensor.plan(RecordedPoses()))]


def _image(place: str, folder: Path) -> Any:
    (folder / "images").mkdir()
    (folder / "images" / "a.png").symlink_to(folder / place)
    sensor = Folder(path=str(folder / "images"))
    return [frames.images for frames in sensor.frames(sensor.plan(RecordedPoses()))]


def _named_in_world(place: str, folder: Path) -> Any:
    (folder / "world.yaml").write_text(WORLD.format(place.replace("\0", "\\0").join('""')))
    return load_world(str(folder / "world.yaml"))


def _mesh_in_world(place: str, folder: Path) -> Any:
    word = place.replace("\0", "\\0").join('""')
    (folder / "world.yaml").write_text(f"map_m: [4, 4]\nobjects: [{{kind: mesh, file: {word}}}]\n")
    return load_world(str(folder / "world.yaml"))


def _run_file(name: str, part: str) -> Callable[[str, Path], Any]:
    def read(place: str, folder: Path) -> Any:
        run = folder / "run"
        run.mkdir()
        for file in {"status.json", "manifest.json", "config.yaml"} - {name}:
            (run / file).write_text("{}")
        (run / name).symlink_to(folder / place)
        return getattr(load_run(run), part)

    return read


READERS: dict[str, Callable[[str, Path], Any]] = {  # what opens `place`, a name, from `folder`
    "world": lambda place, _: load_world(place),
    "mesh world": lambda place, _: load_world(f"{place}.obj"),
    "texture of a world": _named_in_world,
    "mesh of a world": _mesh_in_world,
    "calibration": lambda place, _: load_camera(place),
    "calib_results": lambda place, _: load_camera(f"{place}.txt"),
    "poses": lambda place, _: read_trajectory(Path(place)),
    "positions": lambda place, _: read_table(Path(place)),
    "graph": lambda place, _: read_graph(Path(place)),
    "map": lambda place, _: load_places(map_file(Path(place))),
    "places of a map": lambda place, _: load_places(Path(place)),
    "about a map": lambda place, _: about_map(map_file(Path(place))),
    "arrays": lambda place, _: _arrays(place),
    "network": lambda place, _: Onnx(model=place).describe(np.zeros((1, 8, 16, 3), np.uint8)),
    "eigenspace": lambda place, _: RotationalPca(basis=place).describe(np.zeros((1, 8, 16), np.uint8)),
    "scenario": lambda place, _: scenario(place),
    "plugin": lambda place, _: load_file(file_of(f"{place}.py")),
    "folder of images": lambda place, _: _listed(place),
    "positions of images": lambda place, folder: _images(folder, positions=place),
    "camera of images": lambda place, folder: _images(folder, camera=place),
    "mask of images": lambda place, folder: _images(folder, mask=place),
    "image": _image,
    "status of a run": _run_file("status.json", "status"),
    "manifest of a run": _run_file("manifest.json", "manifest"),
    "metrics of a run": _run_file("metrics.csv", "metrics"),
    "configuration of a run": _run_file("config.yaml", "config"),
}


def _arrays(place: str) -> Any:
    try:
        return read_npz(Path(place))
    except (OSError, ValueError) as error:  # which is its contract
        raise DataError(str(error)) from error


def _listed(place: str) -> Any:
    return Folder(path=place).plan(RecordedPoses())


def _sparse(path: Path) -> None:
    with path.open("wb") as out:
        out.truncate(2**42)


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(path.name)  # whole paths may be too long


def _chain(path: Path) -> None:
    path.symlink_to(path.name + "_")
    path.with_name(path.name + "_").symlink_to(path.name)


ODD: dict[str, Callable[[Path], Any]] = {
    "pipe": os.mkfifo,
    "socket": _socket,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "terminal": lambda path: path.symlink_to("/dev/stdin"),
    "circle": lambda path: path.symlink_to(path.name),
    "circle of two": _chain,
    "dangling": lambda path: path.symlink_to("nothing"),
    "folder": lambda path: path.mkdir(),
    "sparse": _sparse,
    "proc": lambda path: path.symlink_to("/proc/kmsg"),
    "empty": lambda path: path.touch(),
}  # fmt: skip
NAMES = {
    "NUL": "a\0b",
    "long name": "a" * 300,
    "long path": "a/" * 3000,
    "no such user": "~nobody_of_this_name/x",
    "root": "/",
}


@contextmanager
def at_once() -> Iterator[None]:
    """Fails what waits for ever."""

    def late(*_: Any) -> None:
        raise AssertionError(f"it took more than {SECONDS} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def expect_a_sentence(what: str, place: str, folder: Path) -> None:
    with at_once(), pytest.raises(OmnilabError) as refused:
        READERS[what](place, folder)
    assert "\n" not in str(refused.value)


LEFT_OUT = {  # what it should be, the user's own program, or as if it had not been written
    *product(["folder of images"], ["folder"]),
    *product(["plugin"], ["empty", "proc", "sparse"]),
    *product(["metrics of a run"], ["circle", "circle of two", "dangling"]),
    *product(["folder of images"], ["root"]),
    *product(["image", *(what for what in READERS if what.endswith("of a run"))], NAMES),  # links, of any name
}


@pytest.mark.parametrize(("what", "odd"), sorted({*product(READERS, ODD)} - LEFT_OUT))
def test_what_is_no_regular_file_is_never_waited_for(tmp_path, monkeypatch, what, odd):
    monkeypatch.chdir(tmp_path)
    for ending in ("", ".obj", ".txt", ".py"):
        ODD[odd](tmp_path / f"odd{ending}")
    expect_a_sentence(what, "odd", tmp_path)


@pytest.mark.parametrize(("what", "name"), sorted({*product(READERS, NAMES)} - LEFT_OUT))
def test_names_that_none_can_be(tmp_path, monkeypatch, what, name):
    monkeypatch.chdir(tmp_path)
    expect_a_sentence(what, NAMES[name], tmp_path)
