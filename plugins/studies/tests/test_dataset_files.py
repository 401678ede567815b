"""Files of a data set: what a killed process or a second one leaves stops nobody, and what is not ours is refused."""

import contextlib
import os
import threading
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from omnilab.errors import DataError
from omnilab_studies.common.dataset_files import DataSet, component_settings, default_settings

CONTENTS = {"sensor": {"class": "package.Sensor"}, "planned": 2}


class KilledError(BaseException):
    """The process ends here."""


@pytest.mark.parametrize("operation", ["mkdir", "open", "replace"])
@pytest.mark.parametrize("times", [1, 2, 3])
def test_a_data_set_begins_again_from_every_point_at_which_it_was_killed(tmp_path, monkeypatch, operation, times):
    data, left = DataSet(tmp_path / "set"), [times]
    real = getattr(Path, operation)

    def killed(self, *args, **kwargs):
        left[0] -= 1
        if left[0] == 0:
            if operation == "open":
                real(self, *args, **kwargs).close()
            raise KilledError
        return real(self, *args, **kwargs)

    with monkeypatch.context() as patch:
        patch.setattr(Path, operation, killed)
        patch.setattr(Path, "unlink", lambda *_, **__: None)  # a killed process cleans nothing up
        with contextlib.suppress(KilledError):
            data.open(CONTENTS)
    data.open(CONTENTS)
    data.write(0, np.zeros((2, 2), np.uint8), None)
    assert data.has(0)


def test_what_a_killed_process_of_an_earlier_version_left_is_no_hindrance(tmp_path):
    (tmp_path / "images").mkdir()
    (tmp_path / "dataset.json.part").write_text("{")
    DataSet(tmp_path).open(CONTENTS)


@pytest.mark.parametrize("name", ["images/mine.png", "mine.part", "notes.txt"])
def test_a_folder_with_files_of_somebody_else_is_refused(tmp_path, name):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    with pytest.raises(DataError, match="neither empty nor a data set; give a new folder"):
        DataSet(tmp_path).open(CONTENTS)
    assert (tmp_path / name).read_text() == "mine"


def test_what_a_killed_process_left_of_a_frame_goes_and_nothing_else(tmp_path):
    DataSet(tmp_path).open(CONTENTS)
    names = {
        "000003.png.999999999-0123abcd.part": False,  # no process has this number
        f"000003.png.{os.getpid()}-0123abcd.part": True,  # whose writer lives
        "mine.part": True,
        "000003.png.part": True,
    }
    for name in names:
        (tmp_path / "images" / name).write_bytes(b"half")
    DataSet(tmp_path).open(CONTENTS)
    assert {name: (tmp_path / "images" / name).exists() for name in names} == names


def test_two_that_write_the_same_files_do_not_meet(tmp_path):
    data, failed = DataSet(tmp_path), []
    data.open(CONTENTS)

    def write():
        try:
            for n in range(50):
                data.write(n % 2, np.full((8, 8), n % 2, np.uint8), np.ones((8, 8)))
        except DataError as error:
            failed.append(error)

    threads = [threading.Thread(target=write) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failed == []
    assert [int(data.read(n).max()) for n in (0, 1)] == [0, 1]
    assert not list(tmp_path.rglob("*.part"))


@dataclass
class Sensor:
    size: int = 64
    scale: float = 1.0  # came with a later version
    names: list[str] = field(default_factory=lambda: ["a"])  # this, too


def test_a_data_set_begun_before_a_setting_existed_goes_on_with_its_default_alone(tmp_path):
    def contents(sensor):
        return {"sensor": component_settings(sensor)}

    begun = contents(Sensor())
    del begun["sensor"]["scale"], begun["sensor"]["names"]
    defaults = {"sensor": default_settings(Sensor(size=32, scale=2.0))}
    DataSet(tmp_path).open(begun)
    DataSet(tmp_path).open(contents(Sensor()), defaults)
    for other, what in (
        (Sensor(scale=0.01), "sensor.scale is 1.0, not 0.01"),
        (Sensor(size=32), "sensor.size is 64, not 32"),
    ):
        with pytest.raises(DataError, match=what):
            DataSet(tmp_path).open(contents(other), defaults)


def test_an_image_that_would_fill_the_memory_is_no_whole_one(tmp_path):
    data = DataSet(tmp_path)
    data.open(CONTENTS)
    data.write(0, pixels := np.arange(12, dtype=np.uint8).reshape(3, 4), None)
    assert np.array_equal(data.read(0), pixels)
    png = data.image(0).read_bytes()
    for spoilt in (png[:16] + b"\0\1\0\0" * 2 + png[24:], b"BM" + bytes(100), png[:20]):
        data.image(0).write_bytes(spoilt)
        with pytest.raises(DataError, match="is no whole image; delete it and run this again"):
            data.read(0)
    data.image(0).unlink()
    with pytest.raises(DataError, match="cannot be read"):
        data.read(0)
