"""Maps whose descriptor or distance names a file: one that is known by its digest, or given by the user, or none."""

from __future__ import annotations

import hashlib
import os

import numpy as np
import pytest
from omegaconf import OmegaConf

from omnilab.api import Places, Signatures
from omnilab.errors import ConfigError, DataError
from omnilab.runner.build import build
from omnilab.runner.config import Run
from omnilab.runner.map_file import save_map
from omnilab.runner.registry import discover


@pytest.fixture(scope="module")
def registry():
    return discover()


@pytest.fixture
def model(tmp_path):
    file = tmp_path / "net.onnx"
    file.write_bytes(b"a network")
    return file


@pytest.fixture
def built(tmp_path, registry):
    """`built({setting: value}, digests, **given)`: the run with a map that was described by `onnx` with these settings."""

    def built(settings, digests=None, name="onnx", **given):
        about = {
            "components": {"descriptor": {"name": name}, "distance": {"name": "cosine"}},
            "config": {"descriptor": settings, "distance": {}},
        }
        about |= {} if digests is None else {"files": digests}
        save_map(tmp_path / "map.npz", Places(Signatures(np.ones((2, 3), np.float32)), None, ["a", "b"]), about)
        config = OmegaConf.structured(Run)
        config.study = OmegaConf.structured(registry.get("study", "localize").cls)
        config.sensor = OmegaConf.structured(registry.get("sensor", "mirror").cls)
        config.localizer = OmegaConf.structured(registry.get("localizer", "nearest").cls)
        config.map = str(tmp_path / "map.npz")
        if given:
            config.descriptor = OmegaConf.merge(OmegaConf.structured(registry.get("descriptor", name).cls), given)
        return build(config, registry)

    return built


def digest(file):
    return hashlib.sha256(file.read_bytes()).hexdigest()


def test_the_file_that_a_map_was_made_with_is_opened(built, model):
    assert built({"model": str(model)}, {"descriptor.model": digest(model)}).descriptor.model == str(model)


@pytest.mark.parametrize("digests", [None, {}, {"descriptor.model": "0" * 64}], ids=str)
def test_any_other_is_not(built, model, digests):
    with pytest.raises(ConfigError, match=r"give it yourself: descriptor=onnx descriptor\.model="):
        built({"model": str(model)}, digests)


@pytest.mark.parametrize("place", ["/etc/passwd", "/dev/zero", "pipe", "~/net.onnx"])
def test_no_file_of_the_machine_is(built, tmp_path, model, monkeypatch, place):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ConfigError, match="is not known to be what it was made with"):
        built({"model": place}, {})


def test_the_user_may_name_it_wherever_it_lies(built, model):
    assert built({"model": "/home/a/net.onnx"}, {"descriptor.model": digest(model)}, model=str(model))
    assert built({"model": str(model)}, None, model=str(model)), "of a map of before, which has no digests"


def test_another_file_or_another_setting_is_another_descriptor(built, model):
    for digests, given in (({"descriptor.model": "0" * 64}, {}), ({"descriptor.model": digest(model)}, {"width": 8})):
        with pytest.raises(ConfigError, match="the run's descriptor is another or set otherwise"):
            built({"model": str(model)}, digests, model=str(model), **given)


@pytest.mark.parametrize("digests", [[], 3, {"descriptor.model": None}], ids=str)
def test_files_that_are_no_digests(built, model, digests):
    with pytest.raises(DataError, match="its files are no digests"):
        built({"model": str(model)}, digests)


def test_nothing_is_inserted_into_what_a_map_says(built, monkeypatch):
    monkeypatch.setenv("SECRET", "abracadabra")
    assert built({"model": "x", "output": "${oc.env:SECRET}"}, {}).descriptor.output == "${oc.env:SECRET}"


@pytest.mark.parametrize("name", ["os.system", "omnilab_appearance.descriptors.radon.Radon", "../radon", "", "poc"])
def test_components_are_those_that_are_registered(built, name):
    with pytest.raises(ConfigError):
        built({}, {}, name=name)


def test_a_component_without_a_name(built):
    with pytest.raises(DataError, match="does not say what its descriptor was"):
        built({}, {}, name=None)
