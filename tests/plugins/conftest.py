"""A plugin in one file, with a study, a recipe and a world."""

from __future__ import annotations

from pathlib import Path

import pytest

PLUGIN = '''
from dataclasses import dataclass
from typing import ClassVar
from omnilab import Metric, Report, hookimpl

@dataclass
class Count:
    """As far as it is told."""
    upto: int = 3  # how far
    step_m: float = 0.7  # of nothing, as studies of ours have one of their grid
    needs: ClassVar[tuple[str, ...]] = ("sensor",)
    metric_names: ClassVar[tuple[str, ...]] = ("counted",)
    def run(self, parts, record, rng):
        return Report([Metric("counted", float(self.upto), "1"), Metric("step", self.step_m, "m")])

@hookimpl
def register_studies(register):
    register("count", Count)

@hookimpl
def register_folders(register):
    register("ours")
'''
RECIPE = """\
# @package _global_
# Counts to five.
defaults:
  - override /sensor: mirror
  - override /study: count

sensor: { world: hall }
study: { upto: 5 }
"""
WORLD = """\
# A hall.
map_m: [8, 6]
textures: {red: {kind: plain, color: [200, 0, 0]}}
objects:
  - {kind: box, name: chest, at: [0, 2], size: [1, 1, 1], texture: red}
"""


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder `ours` of the plugin, beside its file, mine.py, in the folder that the test is in."""
    monkeypatch.setenv("OMNILAB_PLUGINS", "mine.py")
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(PLUGIN)
    (folder := tmp_path / "ours").mkdir()
    for file, content in ("experiment/count_five.yaml", RECIPE), ("worlds/hall.yaml", WORLD):
        (folder / file).parent.mkdir(exist_ok=True)
        (folder / file).write_text(content)
    return folder
