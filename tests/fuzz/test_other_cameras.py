"""Recipes with a 360-degree camera instead of their own sensor: each composes and builds, and each study runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from fuzz_runs import BASES, PATH, SENSOR, configured, report_of
from fuzz_settings import registered

from omnilab.runner.overrides.composition import check_build, compose
from omnilab.runner.overrides.recipe_loader import use_recipe_loader

QUICK = ("localization", "trajectory", "robustness")  # the others are marked slow
RECIPES = sorted(path.stem for path in (Path(__file__).parents[2] / "conf/experiment").glob("*.yaml"))
TINY = {
    "equirectangular": ("sensor.width=64", "sensor.height=32"),
    "cylindrical": ("sensor.width=64", "sensor.height=16"),
}
WITHOUT = [
    name for name, base in BASES.items() if not set(SENSOR) <= set(base.overrides)
]  # they take no images, or those of a sphere
RUNS = [
    pytest.param(name, sensor, marks=[] if name in QUICK and sensor == "equirectangular" else pytest.mark.slow)
    for name in BASES
    for sensor in TINY
    if name not in WITHOUT
]


def test_only_studies_without_a_mirror_are_left_out():
    assert not [name for name in WITHOUT if any(word.startswith("sensor.size") for word in BASES[name].overrides)]


@pytest.mark.parametrize(("name", "sensor"), RUNS)
def test_a_study_runs_with_a_360_degree_camera(name, sensor, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("path.csv").write_text(PATH)
    base = BASES[name]
    _, size, _ = SENSOR
    assert size.startswith("sensor.size=")
    words = tuple(word for word in base.overrides if word != size)
    registry = registered()
    use_recipe_loader(registry)
    report_of(configured(replace(base, overrides=(*words, f"sensor={sensor}", *TINY[sensor])), registry), registry)


@pytest.mark.slow
def test_every_recipe_takes_a_360_degree_camera(tmp_path):
    registry = registered()
    needed = {
        "render": (f"study.folder={tmp_path}",), "known_views": (f"sensors.known.path={tmp_path}",),
        "recorded_views": ("odometry.file=wheels.tum",),
    }  # fmt: skip
    for recipe in RECIPES:
        recorded = (f"sensor.path={tmp_path}", "sensor.panorama=equirectangular")
        words = recorded if recipe.startswith("recorded") else ("sensor=equirectangular",)
        if not recipe.endswith("localize"):  # which take a map
            config = compose((f"experiment={recipe}", *words, *needed.get(recipe, ())), registry).config
            assert check_build(config, registry)
