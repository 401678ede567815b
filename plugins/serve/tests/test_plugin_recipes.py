"""Recipes and worlds that plugins ship are offered, composed and accepted as ours are."""

import pytest

from omnilab.errors import ConfigError
from omnilab.runner.registry import discover
from omnilab_serve.composing.catalog import catalog
from omnilab_serve.composing.form import form
from omnilab_serve.composing.network import Bounds, check_words
from omnilab_serve.composing.pictures import worlds_of

PLUGIN = """
from omnilab import hookimpl

@hookimpl
def register_folders(register):
    register("shipped")
"""
FILES = {
    "mine.py": PLUGIN,
    "shipped/experiment/coarse.yaml": "# @package _global_\n# Few places.\n# For a look.\n"
    "defaults: [quickstart, _self_]\nsensor: {world: hall}\nstudy: {step_m: 1.5}\n",
    "shipped/worlds/hall.yaml": "map_m: [8, 6]\nobjects: []\n",
}


@pytest.fixture
def registry(tmp_path, monkeypatch):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setenv("OMNILAB_PLUGINS", str(tmp_path / "mine.py"))
    return discover()


@pytest.mark.slow
def test_a_plugins_recipe_has_its_form(registry):
    assert {"name": "coarse", "summary": "Few places.", "notes": "For a look."} in catalog(registry)["recipes"]
    slots = {slot["path"]: slot for slot in form(registry, "coarse")["slots"]}
    values = {setting["path"]: setting["value"] for path in ("sensor", "study") for setting in slots[path]["settings"]}
    assert (values["sensor.world"], values["study.step_m"]) == ("hall", "1.5")
    world = next(setting for setting in slots["sensor"]["settings"] if setting["path"] == "sensor.world")
    assert {"hall", "room"} <= set(world["suggestions"])
    assert "hall" in worlds_of(registry.get("sensor", "mirror").cls)


def test_it_is_asked_for_over_the_network(registry, tmp_path):
    bounds = Bounds(str(tmp_path / "logs"), [])
    assert check_words(["experiment=coarse", "study.step_m=2"], registry, bounds) == "coarse"
    with pytest.raises(ConfigError, match=r"did you mean experiment=coarse\?"):
        check_words(["experiment=coarser"], registry, bounds)
