"""The table of kinds is the one place where a kind is declared: all else is derived from it, or agrees with it."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from omnilab import hooks, testing
from omnilab.api import KINDS, Parts
from omnilab.errors import with_article
from omnilab.runner.config import Run, Settings
from omnilab.runner.registry import members

ROOT = Path(__file__).parents[2]

PLUGIN = '''
from dataclasses import dataclass
from typing import ClassVar
from omnilab import Metric, Report, hookimpl

@dataclass
class North:
    """A compass that is right."""
    declination_deg: float = 0.0
    def plan(self, request): ...
    def frames(self, plan): ...
    def scene(self): ...

@dataclass
class Pointing:
    """What compasses say."""
    needs: ClassVar = ("compass", "compasses")
    def run(self, parts, record, rng):
        found = [parts.compass, *parts.compasses.values()]
        return Report([Metric("declination", sum(c.declination_deg for c in found), "deg")])

@hookimpl
def register_compasses(register):
    register("north", North)

@hookimpl
def register_studies(register):
    register("pointing", Pointing)
'''
RECIPE = """# @package _global_
defaults:
  - override /compass: north
  - override /study: pointing
"""


@pytest.mark.slow
def test_a_new_kind_is_declared_in_one_place(tmp_path: Path) -> None:
    """One line more in the table, and it has a hook, a slot, a dictionary, a choice, and reaches the study."""
    source = tmp_path / "source/omnilab"
    shutil.copytree(ROOT / "omnilab", source, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "conf", source / "conf", ignore=shutil.ignore_patterns("__pycache__"))
    table = source / "api/kinds.py"
    before, found, after = table.read_text().partition('        Kind("study"')
    assert found
    table.write_text(
        f'{before}        Kind("compass", "compasses", Sensor, "From an image to north."),\n{found}{after}'
    )
    (tmp_path / "compass.py").write_text(PLUGIN)
    (tmp_path / "conf/experiment").mkdir(parents=True)
    (tmp_path / "conf/experiment/pointing.yaml").write_text(RECIPE)

    def omnilab(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "omnilab", *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=120,
            env={"PYTHONPATH": str(source.parent), "OMNILAB_PLUGINS": "compass.py", "PATH": "", "HOME": str(tmp_path)},
            check=False,
        )  # fmt: skip

    listed = omnilab("plugins")
    assert "\ncompass\n  north" in listed.stdout, listed.stderr
    ran = omnilab(
        "--config-dir", "conf", "experiment=pointing", "compass.declination_deg=2",
        "+compass@compasses.b=north", "compasses.b.declination_deg=5", "~sink@sinks.rerun", "~sink@sinks.mcap",
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    assert "declination" in ran.stdout
    assert "7" in ran.stdout
    lacking = omnilab("--config-dir", "conf", "experiment=pointing")
    assert lacking.returncode == 2
    assert "the study needs compasses, and none is chosen; give +compass@compasses.NAME=north" in lacking.stderr


def test_runs_have_the_slots_and_dictionaries_of_the_table() -> None:
    slots = [kind.name for kind in KINDS.values() if kind.slot]
    many = [kind.plural for kind in KINDS.values() if kind.many]
    assert [f.name for f in fields(Run)] == [*slots, *many, *(f.name for f in fields(Settings))]


def test_what_type_checkers_see_of_parts_is_what_there_is() -> None:
    tree = ast.parse((ROOT / "omnilab/api/kinds.py").read_text(encoding="utf-8"))
    (declared,) = (node for node in ast.walk(tree) if isinstance(node, ast.ClassDef) and node.name == "Parts")
    annotated = {
        node.target.id: ast.unparse(node.annotation)
        for node in declared.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    assert list(annotated) == [f.name for f in fields(Parts)]
    for kind in KINDS.values():
        if kind.part and kind.slot:
            assert annotated[kind.name] == kind.protocol.__name__
        if kind.part and kind.many:
            assert annotated[kind.plural] == f"Mapping[str, {kind.protocol.__name__}]"


def test_every_kind_has_a_hook_a_check_and_says_what_it_is() -> None:
    specified = {name: hook for name, hook in vars(hooks.hookspecs()).items() if name.startswith("register_")}
    assert set(specified) == {
        *(kind.hook for kind in KINDS.values()),
        hooks.COMMANDS_HOOK,
        hooks.FOLDERS_HOOK,
        hooks.DEVICES_HOOK,
    }
    for kind in KINDS.values():
        assert specified[kind.hook].__doc__ == kind.summary
        assert callable(getattr(testing, f"check_{kind.name}"))


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_every_kind_is_documented_member_by_member(kind) -> None:
    assert kind.protocol.__doc__
    assert kind.summary.endswith(".")
    for member in members(kind.protocol):
        if callable(method := getattr(kind.protocol, member, None)):
            assert method.__doc__, member


def test_nouns_have_their_articles() -> None:
    assert with_article("odometry") == "an odometry"
    assert with_article("backend") == "a backend"
