"""A study without a recipe of its own: on the components of the quickstart, with its own settings and under its name."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from omnilab.errors import ConfigError
from omnilab.manifest import recipe_of
from omnilab.runner.config import run_name
from omnilab.runner.overrides.composition import compose
from omnilab.runner.registry import discover

LATEST = Path("logs/latest")
pytestmark = pytest.mark.usefixtures("plugin")


def metrics() -> dict[str, float]:
    with (LATEST / "metrics.csv").open(newline="") as file:
        return {row["metric"]: float(row["value"]) for row in csv.DictReader(file)}


@pytest.mark.parametrize("words", [["study=count"], ["~experiment", "study=count", "sensor=mirror"]])
def test_it_runs_with_its_own_defaults_and_is_named_so(words: list[str], omnilab_here: Callable[..., Any]) -> None:
    rc, _, err = omnilab_here(*words, "study.upto=4", "~sinks.rerun", "~sinks.mcap")
    assert (rc, err) == (0, "")
    assert metrics() == {"counted": 4.0, "step": 0.7}
    assert LATEST.resolve().parent.name == "count"
    manifest = json.loads((LATEST / "manifest.json").read_text())
    assert manifest["experiment"] == "count"
    assert recipe_of("count", manifest["overrides"]) == (None if "~experiment" in words else "quickstart")


@pytest.mark.slow
def test_it_is_repeated_and_swept_under_its_name(omnilab_here: Callable[..., Any]) -> None:
    rc, _, err = omnilab_here("-m", "study=count", "study.upto=1,2", "~sinks.rerun", "~sinks.mcap")
    assert rc == 0, err
    (summary,) = Path("logs").rglob("summary.csv")
    assert summary.parts[1] == "count"
    assert omnilab_here("repeat", str(summary.parent / "1")).rc == 0
    assert LATEST.resolve().parent == Path("logs/count").resolve()
    assert metrics()["counted"] == 2


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["study=grid,steps"], "grid-steps"),
        (["experiment=grid,grid,room"], "grid-room"),
        (["study=a,b,c,d,e"], "a-and-4-more"),
        (["study=grid"], "grid"),
        (["descriptor=radon,hog"], "quickstart"),
    ],
)
def test_a_sweep_is_called_by_what_it_is_over(words: list[str], name: str) -> None:
    assert run_name({"experiment": "quickstart", "study": "grid"}, words) == name


def test_what_it_lacks_is_said(omnilab_here: Callable[..., Any]) -> None:
    assert "give experiment=NAME or study=NAME" in omnilab_here("~experiment").stderr
    assert "the study needs a sensor" in omnilab_here("~experiment", "study=count").stderr
    assert "left out by ~experiment" in omnilab_here("experiment=null", "study=count").stderr
    assert not Path("logs/count").exists() or not list(Path("logs/count").iterdir())


def test_settings_of_a_recipe_are_of_its_own_study(caplog: pytest.LogCaptureFixture) -> None:
    """The grid's step is not that of another study, though both are called `step_m`."""
    registry = discover()
    assert compose(["experiment=grid", "study=count"], registry).config.study.step_m == 0.7
    assert "of its own study; study=count has its own: left out" in caplog.text
    assert compose(["experiment=quickstart", "study=grid"], registry).config.study.step_m == 0.4
    with pytest.raises(ConfigError, match=r"'study\.step_mm' is not a setting of Count; there is upto, step_m"):
        compose(["study=count", "study.step_mm=1"], registry)


def test_a_recipe_may_go_on_from_one_of_another_study(plugin: Path) -> None:
    text = "# @package _global_\ndefaults: [quickstart, override /study: count, _self_]\nstudy: { upto: 6 }\n"
    (plugin / "experiment/more.yaml").write_text(text)
    composed = compose(["experiment=more"], discover()).config
    assert (composed.study.upto, composed.study.step_m) == (6, 0.7)
    assert composed.descriptor.angles == compose([], discover()).config.descriptor.angles
