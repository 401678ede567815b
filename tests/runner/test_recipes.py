"""Every recipe composes, and what it names can be built."""

from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_module

from omnilab.api import Places, Signatures
from omnilab.geometry import planar_poses
from omnilab.runner.build import build
from omnilab.runner.config import named_components, resolved_yaml
from omnilab.runner.map_file import save_map
from omnilab.runner.plugins.config_nodes import store_components
from omnilab.runner.registry import discover

RECIPES = sorted(path.stem for path in (Path(__file__).parents[2] / "conf/experiment").glob("*.yaml"))


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_is_whole(name, tmp_path):
    store_components(registry := discover(""))
    overrides = [f"experiment={name}", *([f"sensor.path={tmp_path}"] if name.startswith("recorded") else [])]
    unset = {  # what a user has to give
        "render": f"study.folder={tmp_path}", "recorded_views": "odometry.file=wheels.tum",
        "known_views": f"sensors.known.path={tmp_path}", "live_localize": f"sensor.path={tmp_path}/drive.mp4",
    }  # fmt: skip
    overrides += [unset[name]] if name in unset else []
    if name in {"localize", "live_localize"}:
        poses = planar_poses(np.eye(3))
        used = {"descriptor": {"name": "radon"}, "distance": {"name": "poc"}}
        places = Places(Signatures(np.ones((3, 173, 180), np.float32)), poses, ["a", "b", "c"])
        save_map(tmp_path / "map.npz", places, {"components": used, "config": {"descriptor": {}, "distance": {}}})
        overrides.append(f"map={tmp_path}")
    with initialize_config_module("omnilab.conf", version_base="1.3"):
        run = build(compose("config", overrides), registry)
    assert all(component["name"] for component in named_components(run, registry).values())
    assert {"console", "mcap", "rerun"} <= run.sinks.keys()
    assert resolved_yaml(run)


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_says_what_it_is(name):
    first, second, *_ = (Path(__file__).parents[2] / f"conf/experiment/{name}.yaml").read_text().splitlines()
    assert first == "# @package _global_"
    assert second.startswith("# ")
