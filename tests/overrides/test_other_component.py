"""Recipes with another component than their own: settings that it lacks are left out, and that is said."""

from __future__ import annotations

import pytest

from omnilab.errors import ConfigError
from omnilab.runner.overrides import recipe_loader
from omnilab.runner.overrides.composition import check_build, compose
from omnilab.runner.registry import discover


@pytest.fixture
def said(caplog):
    recipe_loader._say_once.cache_clear()
    return lambda: [record.getMessage() for record in caplog.records]


def settings(said, *words):
    return compose(words, discover("")).config


def test_what_the_other_sensor_lacks_is_left_out_and_said_once(said):
    for _ in range(2):
        sensor = settings(said, "experiment=square", "sensor=equirectangular", "sensor.width=64").sensor
    assert (sensor.world, sensor.width) == ("room", 64)
    assert "size" not in sensor
    (sentence,) = said()
    assert sentence.startswith("experiment/square sets sensor.size, sensor.crop, sensor.a_mm,")
    assert sentence.endswith("sensor.margin_px, which sensor=equirectangular does not have: left out")


def test_the_recipes_own_component_keeps_all(said):
    for words in (("experiment=square",), ("experiment=square", "sensor=mirror")):
        assert settings(said, *words).sensor.size == 960
    assert said() == []


def test_it_holds_for_every_kind_and_for_recipes_that_build_on_others(said):
    assert "rows" not in settings(said, "experiment=large_map", "descriptor=radon").descriptor
    assert settings(said, "experiment=compact_views", "sensor=folder", "sensor.path=x").sensor.path == "x"
    assert [sentence.partition(",")[0] for sentence in said()] == [
        "experiment/large_map sets descriptor.rows",
        "experiment/view_slam sets sensor.world",
    ]


def test_a_trajectory_without_loop_closures_is_asked_for_by_none():
    registry = discover("")
    with pytest.raises(
        ConfigError, match=r"needs a loop_closure, .*; give loop_closure=geometric_verification\|.*\|none"
    ):
        check_build(compose(["experiment=square", "~loop_closure"], registry).config, registry)
    built = check_build(compose(["experiment=square", "loop_closure=none"], registry).config, registry)
    assert type(built.loop_closure).__name__ == "NoLoopClosure"


def test_what_no_component_has_is_refused(omnilab_here, tmp_path):
    (tmp_path / "conf/experiment").mkdir(parents=True)
    recipe = "# @package _global_\n# Mine.\ndefaults: [quickstart, _self_]\nsensor: {szie: 3}\n"
    (tmp_path / "conf/experiment/mine.yaml").write_text(recipe)
    done = omnilab_here("--config-dir", "conf", "experiment=mine", "sensor=equirectangular", "--cfg", "job")
    assert (done.rc, "experiment/mine: 'szie' is not a setting of Equirectangular" in done.stderr) == (2, True)
