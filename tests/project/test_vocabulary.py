"""Names are the field's standard terms: words of the house that were replaced do not come back."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted(
    path
    for folder in (ROOT / "omnilab", *(ROOT / "plugins").glob("*/omnilab_*"))
    for path in folder.rglob("*.py")
    if path.name != "renamed.py"
)
INSTEAD = {  # of a name in code: the standard term
    "amounts": "results",
    "Arrangement": "Embedding",
    "arrange": "embed",
    "asked": "queried, requested",
    "asking": "localization run",
    "attempts": "runs",
    "clocked": "timing",
    "contestant": "method",
    "contestants": "methods",
    "Growing": "IncrementalGraph",
    "growing": "incremental",
    "Learner": "Trainable",
    "Learnt": "TrainedDescriptor",
    "learner": "trainable",
    "learnt": "trained",
    "look": "extract, style",
    "MapMaker": "Embedder",
    "map_makers": "embedders",
    "OnlineBackend": "IncrementalBackend",
    "outcome": "comparison",
    "polish": "gauss_newton",
    "remembered": "cosine_index",
    "rival": "method",
    "rivals": "methods, filters, backends",
    "said": "warnings",
    "searched": "search_cost",
    "shelf": "row_store",
    "short_lists": "candidates",
    "Sighting": "ImageFeatures",
    "sightings": "spherical_features",
    "teller": "tracker, limiter",
    "Teller": "OdometryTracker, LogLimiter",
    "told": "estimate, motion",
    "trials": "results",
    "walks": "simulated_graphs",
    "way": "trajectory, path",
}
ELSEWHERE = {"procedural.py": {"shelf"}}  # a shelf of books
PROTOCOLS = {"Recorder"}  # of which there is one class, of the same name


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Every name that a module gives: of classes, functions, arguments, variables, attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_names_are_standard_terms(path: Path) -> None:
    assert path.stem not in INSTEAD, f"call it {INSTEAD[path.stem]}"
    found = {
        f"{path.name}:{line}: {name}, which is {INSTEAD[name.strip('_')]}"
        for line, name in names(parsed(path))
        if name.strip("_") in INSTEAD.keys() - ELSEWHERE.get(path.name, set())
    }
    assert not found


def test_a_class_name_is_one_class() -> None:
    """Across all packages, private ones apart."""
    homes: dict[str, list[str]] = {}
    for path in SOURCES:
        for node in parsed(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(path.relative_to(ROOT).as_posix())
    assert {name: found for name, found in homes.items() if len(found) > 1 and name not in PROTOCOLS} == {}
