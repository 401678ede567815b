"""Every registered component has its conformance check among the tests."""

from __future__ import annotations

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

from omnilab.api import KINDS
from omnilab.runner.registry import discover

ROOT = Path(__file__).parents[2]
STRICTER = {"localizer": ("check_localizer", "check_embedder")}  # checks that make another of the same kind, too
COMPONENTS = discover("").components


@cache
def checked() -> dict[str, set[str]]:
    """The names that stand in test modules which call a check, by the check."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in [*(ROOT / "tests").rglob("test_*.py"), *(ROOT / "plugins").glob("*/tests/**/test_*.py")]:
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        names = {node.id for node in nodes if isinstance(node, ast.Name)}
        names |= {node.attr for node in nodes if isinstance(node, ast.Attribute)}  # omnilab_mirror.Mirror
        names |= {str(node.value) for node in nodes if isinstance(node, ast.Constant)}  # a table of class names
        calls = {node.func.id for node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
        for check in calls:
            if check.startswith("check_"):
                found[check] |= names
    return found


@pytest.mark.parametrize(("kind", "name"), COMPONENTS, ids=[f"{kind}={name}" for kind, name in COMPONENTS])
def test_a_component_has_its_conformance_check(kind: str, name: str) -> None:
    """A test module calls the check of its kind and names its class."""
    cls = COMPONENTS[kind, name].cls.__name__
    checks = STRICTER.get(kind, (f"check_{kind}",))
    assert any(cls in checked()[check] for check in checks), f"no test calls {' or '.join(checks)} with a {cls}"


def test_there_is_a_component_of_every_kind() -> None:
    assert {kind for kind, _ in COMPONENTS} == set(KINDS)
