"""Runs on a device: what is refused, what the run says of itself, what the cache keeps apart. The device is made up."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from omnilab.errors import ConfigError
from omnilab.runner.cache import DiskCache
from omnilab.runner.registry import discover
from omnilab.runner.run_folder import load_run
from omnilab_appearance import Hog, TinyImage
from omnilab_appearance.accelerated.torch_device import open_device

PLUGIN = '''
from omnilab import Signatures, hookimpl
from omnilab_appearance import TinyImage

class TinyThere(TinyImage):
    """Whose signatures tell where they come from."""
    def describe(self, images):
        return Signatures(super().describe(images).place + 1)

class Fake:
    def __init__(self, name):
        self.computed_on = f"a fake, version {name}"
    def accelerated(self, component):
        if type(component) is not TinyImage:
            return None
        there = object.__new__(TinyThere)
        vars(there).update(vars(component))
        return there

@hookimpl
def register_devices(register):
    register("fake", Fake)
'''
SMALL = (
    "experiment=map", "descriptor=tiny_image", "distance=poc", "study.step_m=3", "sensor.size=48", "sensor.samples=1",
    "~sinks.rerun", "~sinks.mcap",
)  # fmt: skip


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of a plugin with a device."""
    file = tmp_path / "fake.py"
    file.write_text(PLUGIN)
    monkeypatch.setenv("OMNILAB_PLUGINS", str(file))
    return file


@pytest.mark.parametrize(
    ("device", "words"),
    [
        ("cuad", "device=cuad is not served by any plugin; there is cpu, cuda, torch (did you mean device=cuda?)"),
        ("cpu:1", "device=cpu:1 is not served by any plugin"),
        ("cuda:x", "device=cuda:x is no device that torch computes on here; give cuda, cuda:1 or torch:cpu"),
        ("torch", "device=torch is no device that torch computes on here"),
    ],
)
def test_a_device_that_is_none_is_refused(omnilab_here, tmp_path: Path, device: str, words: str) -> None:
    rc, _, err = omnilab_here(*SMALL, f"device={device}")
    assert (rc, err.count("\n")) == (2, 1)
    assert words in err
    assert not list((tmp_path / "logs").rglob("manifest.json"))


def test_a_run_without_torch_is_refused(omnilab_here, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)  # importing it fails
    rc, _, err = omnilab_here(*SMALL, "device=cuda")
    assert (rc, err.count("\n")) == (2, 1)
    assert "device=cuda needs torch, which cannot be imported" in err
    assert "pip install 'omnilab-appearance[gpu]', or give device=cpu" in err


class Torch:
    """Torch, as it would be with so many GPUs."""

    __version__ = "2.99"

    def __init__(self, gpus: int, cuda: str | None) -> None:
        self.cuda, self.version, self._gpus = self, type("version", (), {"cuda": cuda}), gpus

    def device(self, name: str):
        kind, _, index = name.partition(":")
        return type("device", (), {"type": kind, "index": int(index) if index else None})

    def is_available(self) -> bool:
        return self._gpus > 0

    def device_count(self) -> int:
        return self._gpus

    def get_device_name(self, device) -> str:
        return "A GPU"


@pytest.mark.parametrize(
    ("gpus", "cuda", "device", "words"),
    [
        (0, None, "cuda", "torch 2.99 finds no GPU, for it was built without CUDA"),
        (0, "13.0", "cuda", "torch 2.99 finds no GPU; give device=cpu"),
        (2, "13.0", "cuda:2", "device=cuda:2 is not there: the last one is cuda:1"),
    ],
)
def test_a_gpu_that_is_not_there_is_refused(monkeypatch, gpus: int, cuda: str | None, device: str, words: str) -> None:
    monkeypatch.setitem(sys.modules, "torch", Torch(gpus, cuda))
    with pytest.raises(ConfigError, match="is not there") as refusal:
        open_device(device)
    assert words in str(refusal.value)


def test_two_gpus_of_a_kind_are_called_the_same(monkeypatch) -> None:
    """And share what the cache keeps."""
    monkeypatch.setitem(sys.modules, "torch", Torch(2, "13.0"))
    assert {open_device(name).computed_on for name in ("cuda", "cuda:0", "cuda:1")} == {
        "A GPU, by torch 2.99, CUDA 13.0"
    }


def test_a_plugin_cannot_take_the_processor_s_name_nor_one_twice(tmp_path: Path) -> None:
    for name, words in (("cpu", "other than cpu"), ("fake", "device 'fake' is")):
        file = tmp_path / f"also_{name}.py"
        file.write_text(f'{PLUGIN}    register("{name}", Fake)\n')
        (failure,) = discover(f"omnilab-appearance,none,{file}").failures
        assert words in failure.sentence


def test_a_run_says_where_each_component_was_computed(omnilab_here, tmp_path: Path, fake: Path) -> None:
    rc, _, err = omnilab_here(*SMALL, "device=fake:1")
    assert rc == 0, err
    assert err.count("device=fake:1 computes no distance 'poc'; the processor does\n") == 1
    run = load_run(tmp_path / "logs/latest")
    where = {slot: used["computed_on"] for slot, used in run.manifest["components"].items()}
    assert where.pop("descriptor") == "a fake, version fake:1"
    assert set(where.values()) == {"cpu"}
    assert run.config["device"] == "fake:1"
    with np.load(tmp_path / "logs/latest/map.npz") as there:
        about = json.loads(str(there["about"]))
        assert about["components"]["descriptor"]["computed_on"] == "a fake, version fake:1"
        place = there["place"]
    assert omnilab_here(*SMALL)[0] == 0, "the cache of the other device lies beside it"
    run = load_run(tmp_path / "logs/latest")
    assert "device" not in run.config
    assert not any("computed_on" in used for used in run.manifest["components"].values())
    with np.load(tmp_path / "logs/latest/map.npz") as here:
        np.testing.assert_array_equal(place, here["place"] + 1)


def test_the_cache_keeps_devices_apart(tmp_path: Path) -> None:
    images = np.random.default_rng(0).integers(0, 255, (3, 16, 32), dtype=np.uint8)
    made = []
    for computed_on in ("", "a GPU, by torch 2.1", "a GPU, by torch 2.2", "a GPU, by torch 2.1"):
        cache = DiskCache(tmp_path / "cache", 10**9, 1)
        cache.wrap(TinyImage(rows=4, columns=8), computed_on).describe(images)
        made.append(cache.made["describe"])
    assert made == [3, 3, 3, 0]
    abouts = [file.read_text() for file in (tmp_path / "cache").glob("*/about.txt")]
    assert len(abouts) == 3
    assert sum("\ndevice a GPU, by torch 2.1\n" in about for about in abouts) == 1
    assert sum("\ndevice " not in about for about in abouts) == 1


@pytest.mark.slow
def test_the_processor_needs_no_torch(omnilab, tmp_path: Path) -> None:
    shadow = tmp_path / "shadow"
    shadow.mkdir()
    (shadow / "torch.py").write_text(
        "from pathlib import Path\nPath(__file__).with_name('seen').touch()\nraise ImportError('a shadow')\n"
    )
    rc, _, err = omnilab(*SMALL, "descriptor=hog", "distance=pearson", env={"PYTHONPATH": str(shadow)})
    assert rc == 0, err
    assert not (shadow / "seen").exists()
    rc, _, err = omnilab(*SMALL, "device=torch:cpu", env={"PYTHONPATH": str(shadow)})
    assert rc == 2
    assert "which cannot be imported (a shadow)" in err
    assert (shadow / "seen").exists()


def test_a_class_derived_from_one_that_computes_there_does_not() -> None:
    class Mine(Hog):
        """Derived from one that has: what it overrides is not known."""

    torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'omnilab-appearance[gpu]'")
    device = open_device("torch:cpu")
    assert device.computed_on == f"the processor, by torch {torch.__version__}"
    assert device.accelerated(Mine()) is None
    assert isinstance(device.accelerated(Hog()), Hog)
