"""Which way imports point: plugins to the contract, the runner to the registry, nothing to a plugin."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
CORE = sorted((ROOT / "omnilab").glob("*.py"))
PLUGINS = sorted(path.parent for path in (ROOT / "plugins").glob("*/pyproject.toml"))

CONTRACT = {
    "",
    "api",
    "errors",
    "geometry",
    "graph_files",
    "graphs",
    "hooks",
    "metrics",
    "projection",
    "testing",
    "trajectories",
    "trajectory_files",
}  # "": omnilab itself
LAYERS = (  # a module of omnilab imports from the layers before its own
    {"api", "errors", "geometry", "hooks", "interrupts"},
    {"cameras", "distortion", "graphs"},
    {"graph_files", "trajectories", "trajectory_files"},
    {"lenses", "mirrors"},
    {"noncentral", "ocam", "stereo"},
    {"calibration", "resample"},
    {"", "console", "metrics", "projection"},
    {"fingerprint", "logbook", "maps", "record", "registry", "shelf"},
    {"cache"},
    {"run", "terminal", "testing"},
    {"experiment"},
    {"cli"},
    {"__main__"},
)
THIRD_PARTY = {  # which modules of omnilab may import what, beside numpy
    "hydra": {"registry", "run", "experiment"},
    "omegaconf": {"registry", "run", "experiment"},
    "pluggy": {"hooks", "registry"},
    "cv2": {"projection", "resample"},
    "rich": {"cli", "console", "terminal"},
    "threadpoolctl": {"run"},
    "yaml": {"logbook"},
}
LAZY = {"cv2", "rich", "threadpoolctl", "yaml"}  # within functions only: importing omnilab is free of work
HEAVY = {"cv2", "gtsam", "matplotlib", "mcap", "numba", "rerun", "scipy", "skimage"}


class Import(NamedTuple):
    """One import statement's module, and whether it waits for a call (or for a type checker)."""

    module: str
    lazy: bool

    @property
    def top(self) -> str:
        return self.module.partition(".")[0]


def imports(path: Path) -> Iterator[Import]:
    """Every module that a file imports; `from omnilab import api` is an import of omnilab.api."""

    def visit(node: ast.AST, lazy: bool) -> Iterator[Import]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import):
                yield from (Import(name.name, lazy) for name in child.names)
            elif isinstance(child, ast.ImportFrom):
                assert child.level == 0, f"{path}:{child.lineno} is a relative import"
                yield from (Import(name, lazy) for name in modules_of(child))
            waits = isinstance(child, ast.FunctionDef) or (isinstance(child, ast.If) and typing_only(child))
            yield from visit(child, lazy or waits)

    return visit(ast.parse(path.read_text(encoding="utf-8")), False)


def typing_only(node: ast.If) -> bool:
    return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def modules_of(node: ast.ImportFrom) -> Iterator[str]:
    """The modules named by a `from` import; names that are no files of omnilab are taken from the module itself."""
    for name in node.names:
        if node.module == "omnilab" and (ROOT / "omnilab" / f"{name.name}.py").exists():
            yield f"omnilab.{name.name}"
        else:
            yield str(node.module)


def outside(path: Path) -> list[Import]:
    """Imports that are not of the standard library."""
    return [found for found in imports(path) if found.top not in sys.stdlib_module_names]


def inner(found: Import) -> str:
    """A module's name within omnilab."""
    return found.module.removeprefix("omnilab").removeprefix(".")


def names(paths: list[Path]) -> list[str]:
    return [path.stem if path.is_file() else path.name for path in paths]


# ----------------------------------------------------------------------------------------------------------- the core
def test_the_contract_needs_numpy_only() -> None:
    assert {found.top for found in outside(ROOT / "omnilab/api.py")} == {"numpy"}


@pytest.mark.parametrize("path", CORE, ids=names(CORE))
def test_a_module_of_the_core_imports_from_layers_before_its_own(path: Path) -> None:
    name = path.stem.removeprefix("__init__")
    (own,) = (i for i, layer in enumerate(LAYERS) if name in layer)
    below: set[str] = set().union(*LAYERS[:own])
    assert {inner(found) for found in outside(path) if found.top == "omnilab"} <= below


@pytest.mark.parametrize("path", CORE, ids=names(CORE))
def test_a_module_of_the_core_imports_the_libraries_that_are_its_business(path: Path) -> None:
    for found in outside(path):
        if found.top not in {"numpy", "omnilab"}:
            assert path.stem in THIRD_PARTY.get(found.top, set()), f"{path.name} imports {found.module}"
            assert found.lazy or found.top not in LAZY, f"{path.name} imports {found.module} before it is needed"


def test_every_module_of_the_core_has_its_layer() -> None:
    layered = [name for layer in LAYERS for name in layer]
    assert sorted(layered) == sorted(path.stem.removeprefix("__init__") for path in CORE)


# -------------------------------------------------------------------------------------------------------- the plugins
def sources(plugin: Path) -> list[Path]:
    (package,) = (path.parent for path in plugin.glob("omnilab_*/__init__.py"))
    return sorted(package.rglob("*.py"))


def project(folder: Path) -> dict[str, Any]:
    """The table [project] of a folder's pyproject.toml."""
    return dict(tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"])


@pytest.mark.parametrize("plugin", PLUGINS, ids=names(PLUGINS))
def test_a_plugin_imports_the_contract_and_no_other_plugin(plugin: Path) -> None:
    for path in sources(plugin):
        for found in outside(path):
            if found.top == "omnilab":
                assert inner(found) in CONTRACT, f"{path} imports {found.module}"
            elif found.top.startswith("omnilab_"):
                assert found.top == f"omnilab_{plugin.name}", f"{path} imports {found.module}"


@pytest.mark.parametrize("folder", [ROOT, *PLUGINS], ids=["omnilab", *names(PLUGINS)])
def test_a_distribution_declares_what_it_imports_and_no_more(folder: Path) -> None:
    provided = packages_distributions()
    own = "omnilab" if folder == ROOT else f"omnilab_{folder.name}"
    files = CORE if folder == ROOT else sources(folder)
    imported = {found.top for path in files for found in outside(path)} - {own}
    origins = {top: {normal(name) for name in provided[top]} for top in imported}
    available = dependencies(folder) | (dependencies(ROOT) if "omnilab" in dependencies(folder) else set())
    assert {top for top, origin in origins.items() if not origin & available} == set()
    assert dependencies(folder) - set().union(*origins.values()) == set()


def dependencies(folder: Path) -> set[str]:
    """Also those of extras, but for the extra `all`, which names the plugins."""
    extras = project(folder).get("optional-dependencies", {})
    lines = [*project(folder)["dependencies"], *(line for name in extras if name != "all" for line in extras[name])]
    return {normal(re.split(r"[ \[<>=~!;]", line)[0]) for line in lines}


def normal(name: str) -> str:
    """A distribution's name as the index compares it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


@pytest.mark.parametrize("plugin", PLUGINS, ids=names(PLUGINS))
def test_importing_a_plugin_imports_no_heavy_library(plugin: Path) -> None:
    """Followed through the plugin's own modules, from its entry point."""
    package, waiting, seen = plugin / f"omnilab_{plugin.name}", [f"omnilab_{plugin.name}"], set[str]()
    while waiting:
        module = waiting.pop()
        seen.add(module)
        path = package.parent / (module.replace(".", "/") + ".py")
        now = [found for found in outside(path if path.exists() else package / "__init__.py") if not found.lazy]
        assert not {found.top for found in now} & HEAVY, f"{module} is imported with the plugin"
        waiting += {found.module for found in now if found.top == package.name} - seen


def test_omnilab_all_names_every_plugin() -> None:
    assert sorted(project(ROOT)["optional-dependencies"]["all"]) == sorted(project(p)["name"] for p in PLUGINS)
