"""Recipes and worlds that plugins ship."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from omnilab.errors import ConfigError
from omnilab.runner.overrides.composition import compose
from omnilab.runner.registry import discover

PYPROJECT = """\
[project]
name = "omnilab-count"
version = "1.0"
dependencies = ["omnilab"]
[project.entry-points.omnilab]
count = "omnilab_count"
[tool.setuptools]
packages = ["omnilab_count"]
[tool.setuptools.package-data]
omnilab_count = ["experiment/*.yaml", "worlds/*"]
"""


def test_a_recipe_runs_and_is_repeated(plugin: Path, omnilab_here: Callable[..., Any]) -> None:
    rc, out, err = omnilab_here("experiment=count_five", "study.upto=7", "~sinks.rerun", "~sinks.mcap")
    assert (rc, err) == (0, "")
    assert Path("logs/latest").resolve().parent.name == "count_five"
    assert "counted   7" in out
    rc, _, err = omnilab_here("repeat")
    assert rc == 0
    assert "bit for bit" in err


def test_its_world_is_one_of_the_virtual_cameras(plugin: Path) -> None:
    registry = discover()
    mirror = registry.get("sensor", "mirror").cls
    assert mirror(world="hall").imaged_world[0] == "hall"
    assert "hall" in mirror.shipped_worlds()
    with pytest.raises(ConfigError, match="did you mean 'hall'"):
        mirror(world="hal").scene()
    assert "hall" not in discover("").get("sensor", "mirror").cls.shipped_worlds()


def test_they_are_listed_with_their_plugin(plugin: Path, omnilab_here: Callable[..., Any]) -> None:
    out = omnilab_here("plugins").stdout
    assert f"  count_five  {plugin / 'experiment/count_five.yaml'}, mine.py \n      Counts to five." in out
    assert f"  hall  {plugin / 'worlds/hall.yaml'}, mine.py \n      A hall." in out
    assert " count_five, " in omnilab_here("--help").stdout
    data = json.loads(omnilab_here("plugins", "--json").stdout)
    assert {"kind": "experiment", "name": "count_five"} in [
        {key: each[key] for key in ("kind", "name")} for each in data
    ]
    assert "did you mean experiment=count_five?" in omnilab_here("experiment=count_fiv").stderr
    assert "did you mean experiment=count_five?" in omnilab_here("count_five").stderr


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("mirror", "miror", r"sensor 'miror' does not exist; .* \(did you mean sensor=mirror\?\)"),
        ("upto", "up_to", "experiment/count_five: 'up_to' is not a setting of Count; there is upto"),
        ("{ upto: 5 }", "[5", "ours/experiment/count_five.yaml, line 9, is no YAML; correct it"),
        ("# @package _global_\n", "", "begin it with the line '# @package _global_'"),
        (r"\A.*", "study: { upto: 5 }\n", "begin it with the line '# @package _global_'"),
        ("override /study", "study", "count_five: .* choose experiment/study behind .* write '- override"),
        ("override /", "", "write '- override /study: count', with the slash"),
        ("/study", "study", "write '- override /study: NAME', with the slash"),
        (r"\A.*", "# @package _global_\n- 1\n", "count_five.yaml is a list"),
        (r"\A.*", "# \xff", "count_five.yaml is no text in UTF-8"),
    ],
)
def test_a_wrong_recipe_is_a_sentence(plugin: Path, old: str, new: str, sentence: str) -> None:
    file = plugin / "experiment/count_five.yaml"
    file.write_bytes(re.sub(old, new, file.read_text(), flags=re.DOTALL).encode("latin-1"))
    with pytest.raises(ConfigError, match=sentence):
        compose(["experiment=count_five"], discover())


@pytest.mark.parametrize(
    ("file", "sentence"),
    [
        ("experiment/grid.yaml", "the recipe 'grid' .*ours/experiment/grid.yaml. is registered already by plugin 'omnilab'"),
        ("worlds/room.yaml", "the world 'room' .*ours/worlds/room.yaml. is registered already by plugin 'mirror'"),
        ("experiment/my own.yaml", "my own.yaml has an unusable name"),
        ("experiment/own.yml", "own.yml has an unusable name"),
    ],
)  # fmt: skip
def test_files_that_would_hide_others_or_have_no_name(plugin: Path, file: str, sentence: str) -> None:
    (plugin / file).write_text("# Mine.\n")
    registry = discover()
    (failure,) = registry.failures
    assert re.search(sentence, failure.sentence)
    assert registry.recipes.keys().isdisjoint({"count_five", "own", "my own"})


@pytest.mark.parametrize(("folder", "sentence"), [("'none'", "none, which is not there; put"), ("3", "given 3; give the path"),
                                                  ("'..'", "holds neither; put experiment/NAME.yaml")])  # fmt: skip
def test_folders_that_ship_nothing(plugin: Path, folder: str, sentence: str) -> None:
    file = Path("mine.py")
    file.write_text(file.read_text().replace('"ours"', folder))
    (failure,) = discover().failures
    assert sentence in failure.sentence


def test_two_plugins_with_a_recipe_of_one_name(plugin: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("other.py").write_text(Path("mine.py").read_text().replace('"count"', '"other"'))
    (failure,) = discover("mine.py,other.py").failures
    assert "'count_five'" in failure.sentence
    assert "plugin 'mine' (mine.py)" in failure.sentence


def test_other_files_in_the_folder_stand_for_nothing(plugin: Path) -> None:
    """Hydra would take `sensor/mirror.yaml` for a sensor, before the component, and `config.yaml` for our own."""
    for file in "sensor/mirror.yaml", "sensor/odd.yaml", "config.yaml", "hydra/launcher/basic.yaml":
        (plugin / file).parent.mkdir(parents=True, exist_ok=True)
        (plugin / file).write_text("batch: 7\nnonsense: true\n")
    composed = compose(["experiment=count_five"], discover())
    assert composed.config.sensor.batch != 7
    with pytest.raises(ConfigError, match="sensor 'odd' does not exist"):
        compose(["experiment=count_five", "sensor=odd"], discover())


@pytest.mark.slow
def test_workers_know_them(plugin: Path, omnilab: Callable[..., Any]) -> None:
    """In a process of its own: workers that joblib kept of another test would not."""
    words = ("-m", "hydra/launcher=joblib", "experiment=count_five", "study.upto=1,2")
    rc, out, err = omnilab(*words, env={"OMNILAB_PLUGINS": os.environ["OMNILAB_PLUGINS"]})
    assert rc == 0, err
    assert [line.split()[3] for line in out.splitlines()[-2:]] == ["1", "2"]  # `counted`


@pytest.mark.slow
def test_a_distribution_brings_them(
    installed: Callable[[Path], Path], plugin: Path, omnilab: Callable[..., Any]
) -> None:
    source = plugin.parent / "distribution"
    (package := source / "omnilab_count").mkdir(parents=True)
    (package / "__init__.py").write_text(Path("mine.py").read_text().replace('"ours"', '"."'))
    (plugin / "experiment").rename(package / "experiment")
    (plugin / "worlds").rename(package / "worlds")
    (source / "pyproject.toml").write_text(PYPROJECT)
    where = str(installed(source))
    rc, _, err = omnilab("experiment=count_five", env={"PYTHONPATH": where})
    assert rc == 0, err
    assert f"count_five  {where}/omnilab_count/experiment/" in omnilab("plugins", env={"PYTHONPATH": where}).stdout
