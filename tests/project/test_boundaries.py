"""Which way imports point: plugins to the contract, the runner to the registry, nothing to a plugin."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).parent.parent.parent
TEMPLATES = ROOT / "omnilab/runner/authoring/templates"  # what strangers begin with
CORE = sorted(path for path in (ROOT / "omnilab").rglob("*.py") if TEMPLATES not in path.parents)
PLUGINS = sorted(path.parent for path in (ROOT / "plugins").glob("*/pyproject.toml"))
PACKAGES = {"omnilab": ROOT / "omnilab"} | {f"omnilab_{p.name}": p / f"omnilab_{p.name}" for p in PLUGINS}

# What each part of omnilab (a module or a package at its top) may import of the others. "": omnilab itself.
MAY_IMPORT = {
    "errors": set[str](),
    "file_kinds": set[str](),
    "atomic_files": set[str](),
    "log_files": {"atomic_files", "errors"},
    "log_times": {"api"},
    "manifest": {"file_kinds"},
    "renamed": set[str](),
    "shipped_worlds": set[str](),
    "run_header": {"api", "errors", "manifest"},
    "limits": {"errors"},
    "memory": set(),
    "api": {"errors", "renamed"},
    "arrays": {"api", "file_kinds"},
    "geometry": {"api"},
    "hooks": {"api"},
    "metrics": {"api", "errors", "geometry"},
    "posegraph": {"api", "errors", "file_kinds", "geometry"},
    "trajectory": {"api", "errors", "file_kinds", "geometry", "posegraph"},
    "client": {"atomic_files", "errors"},
    "cameras": {"api", "atomic_files", "errors", "file_kinds", "geometry"},
    "image": {"api", "errors", "cameras", "limits"},
    "": {"api", "errors", "hooks", "renamed"},
    "runner": {
        "",
        "api",
        "arrays",
        "atomic_files",
        "client",
        "limits",
        "memory",
        "manifest",
        "renamed",
        "run_header",
        "errors",
        "file_kinds",
        "geometry",
        "hooks",
        "image",
        "metrics",
        "shipped_worlds",
        "testing",
    },
    "testing": {"", "api", "renamed", "cameras", "errors", "geometry", "image", "posegraph", "runner"},
    "__main__": {"runner"},
}
CONTRACT = set(MAY_IMPORT) - {"runner", "__main__"}  # what plugins may import
FRONTS = {"serve"}  # plugins that stand on the runner, as the command line does
THIRD_PARTY = {  # which modules of omnilab may import what, beside numpy
    "hydra": {
        "runner.plugins.config_nodes", "runner.config", "runner.build", "runner.hydra_app", "runner.overrides.command_line",
        "runner.overrides.composition", "runner.overrides.recipe_loader", "runner.plugins.recipe_source", "runner.sweeps.launcher", "runner.sweeps.plan_file",
        "runner.sweeps.worker",
    },
    "omegaconf": {
        "runner.registry", "runner.plugins.config_nodes", "runner.config", "runner.build", "runner.execute", "runner.hydra_app", "runner.input_files",
        "runner.sweeps.objective", "runner.overrides.command_line", "runner.overrides.compose_errors",
        "runner.overrides.composition", "runner.overrides.recipe_loader", "runner.plugins.recipe_source", "runner.storage.inputs",
        "runner.sweeps.launcher", "runner.sweeps.optuna_study", "runner.sweeps.start",
    },
    "aiohttp": {"runner.storage.fetching"},
    "fsspec": {"runner.storage.fetching"},
    "mkdocs": {"runner.site.command", "runner.site.plugin"},
    "optuna": {"runner.sweeps.optuna_study"},
    "pluggy": {"hooks", "runner.registry"},
    "cv2": {
        "image", "cameras.reproject", "cameras.calibration.corners", "cameras.calibration.grid", "runner.sweeps.worker",
    },
    "rich": {
        "runner.authoring.check", "runner.console_sink", "runner.plugins.command", "runner.terminal", "runner.sweeps.display", "runner.sweeps.status_commands",
        "runner.sweeps.status_table",
    },
    "threadpoolctl": {"runner.execute", "cameras.calibration.calibrate"},
    "yaml": {"runner.run_folder.reading", "runner.sweeps.plan_file", "cameras.formats.safe_yaml"},
    "pandas": {
        "runner.compare.command", "runner.compare.comparison", "runner.compare.order", "runner.compare.paired",
        "runner.compare.tables",
    },
    "scipy": {
        "runner.compare.comparison", "runner.compare.paired", "runner.fidelity.verdicts", "cameras.calibration.bundle",
        "cameras.calibration.calibrate", "cameras.calibration.models",
    },
    "matplotlib": {"runner.compare.figures", "runner.compare.plots"},
}  # fmt: skip
LAZY = {
    "cv2",
    "matplotlib",
    "pandas",
    "rich",
    "scipy",
    "threadpoolctl",
    "yaml",
}  # within functions only: importing omnilab is free of work
HEAVY = {"cv2", "gtsam", "matplotlib", "mcap", "numba", "pandas", "rerun", "scipy", "skimage", "torch"}
MOST_FILES, MOST_LINES = 20, 400  # of a folder, of a module


class Import(NamedTuple):
    """One import statement's module; whether it waits for a call or a type checker; whether for a type checker."""

    module: str
    lazy: bool
    typing: bool

    @property
    def top(self) -> str:
        return self.module.partition(".")[0]


@cache
def imports(path: Path) -> tuple[Import, ...]:
    """Every module that a file imports; `from omnilab import api` is an import of omnilab.api."""

    def visit(node: ast.AST, lazy: bool, typing: bool) -> Iterator[Import]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import):
                yield from (Import(name.name, lazy, typing) for name in child.names)
            elif isinstance(child, ast.ImportFrom):
                assert child.level == 0, f"{path}:{child.lineno} is a relative import"
                yield from (Import(name, lazy, typing) for name in modules_of(child))
            types = isinstance(child, ast.If) and typing_only(child)
            yield from visit(child, lazy or types or isinstance(child, ast.FunctionDef), typing or types)

    return tuple(visit(ast.parse(path.read_text(encoding="utf-8")), False, False))


def typing_only(node: ast.If) -> bool:
    return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


@cache
def file_of(module: str) -> Path | None:
    """The file of a module of ours, `__init__.py` for a package; None of any other module."""
    top, _, rest = module.partition(".")
    if top not in PACKAGES:
        return None
    stem = PACKAGES[top].joinpath(*rest.split(".")) if rest else PACKAGES[top]
    files = (stem / "__init__.py", stem.with_suffix(".py"))
    return next((file for file in files if file.exists()), None)


def module_of(path: Path) -> str:
    """The dotted name of a file of ours."""
    top, folder = next((top, folder) for top, folder in PACKAGES.items() if path.is_relative_to(folder))
    parts = path.relative_to(folder).with_suffix("").parts
    return ".".join([top, *parts]).removesuffix(".__init__")


def modules_of(node: ast.ImportFrom) -> Iterator[str]:
    """The modules named by a `from` import; names that are no modules are taken from the module itself."""
    for name in node.names:
        within = f"{node.module}.{name.name}"
        yield within if file_of(within) else str(node.module)


def outside(path: Path) -> list[Import]:
    """Imports that are not of the standard library."""
    return [found for found in imports(path) if found.top not in sys.stdlib_module_names]


def inner(module: str) -> str:
    """A module's name within omnilab."""
    return module.removeprefix("omnilab").removeprefix(".")


def part_of(module: str) -> str:
    """The part of omnilab that a module belongs to: a module or a package at its top."""
    return inner(module).partition(".")[0]


def names(paths: list[Path]) -> list[str]:
    return [module_of(path) if path.is_file() else path.name for path in paths]


# ----------------------------------------------------------------------------------------------------------- the core
def test_the_contract_needs_numpy_only() -> None:
    api = sorted((ROOT / "omnilab/api").glob("*.py"))
    assert {found.top for path in api for found in outside(path)} - {"omnilab"} == {"numpy"}


@pytest.mark.parametrize("path", CORE, ids=names(CORE))
def test_a_module_of_the_core_imports_the_parts_that_it_may(path: Path) -> None:
    own = part_of(module_of(path))
    imported = {part_of(found.module) for found in outside(path) if found.top == "omnilab"}
    assert imported - {own} <= MAY_IMPORT[own]


@pytest.mark.parametrize("path", CORE, ids=names(CORE))
def test_a_module_of_the_core_imports_the_libraries_that_are_its_business(path: Path) -> None:
    name = inner(module_of(path))
    for found in outside(path):
        if found.top not in {"numpy", "omnilab"}:
            assert name in THIRD_PARTY.get(found.top, set()), f"{name} imports {found.module}"
            assert found.lazy or found.top not in LAZY, f"{name} imports {found.module} before it is needed"


@pytest.mark.parametrize("path", sorted(TEMPLATES.glob("c*/*.py")), ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_a_template_imports_what_a_plugin_may(path: Path) -> None:
    component = module_of(path).replace(".checks.", ".components.")
    for found in outside(path):
        if found.top == "omnilab":
            allowed = CONTRACT if path.parent.name == "components" else CONTRACT | {"runner"}
            assert part_of(found.module) in allowed or found.module == component, f"{path} imports {found.module}"
        else:
            assert found.top == "numpy" or (found.top == "matplotlib" and found.lazy)


def test_every_part_of_the_core_says_what_it_may_import() -> None:
    assert {part_of(module_of(path)) for path in CORE} == set(MAY_IMPORT)


# ------------------------------------------------------------------------------------------------------ every package
@pytest.mark.parametrize("package", PACKAGES)
def test_imports_run_in_no_circle(package: str) -> None:
    """Those within functions count, those for type checkers do not."""
    sources = sorted(PACKAGES[package].rglob("*.py"))
    ahead = {
        module_of(path): {found.module for found in outside(path) if found.top == package and not found.typing}
        for path in sources
    }
    done: set[str] = set()
    while ahead.keys() - done:
        free = {module for module in ahead.keys() - done if ahead[module] - {module} <= done}
        assert free, f"in a circle, or behind one: {sorted(ahead.keys() - done)}"
        done |= free


def test_folders_and_modules_are_small_enough_to_take_in() -> None:
    sources = [path for folder in ("omnilab", "plugins", "tests", "docs") for path in (ROOT / folder).rglob("*.py")]
    folders = Counter(path.parent for path in sources)
    assert {folder: count for folder, count in folders.items() if count > MOST_FILES} == {}
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in sources}
    assert {path: count for path, count in lines.items() if count > MOST_LINES} == {}


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
                allowed = CONTRACT | {"runner"} if plugin.name in FRONTS else CONTRACT
                assert part_of(found.module) in allowed, f"{path} imports {found.module}"
            elif found.top.startswith("omnilab_"):
                assert found.top == f"omnilab_{plugin.name}", f"{path} imports {found.module}"


@pytest.mark.parametrize("folder", [ROOT, *PLUGINS], ids=["omnilab", *names(PLUGINS)])
def test_a_distribution_declares_what_it_imports_and_no_more(folder: Path) -> None:
    provided = packages_distributions()
    own = "omnilab" if folder == ROOT else f"omnilab_{folder.name}"
    files = CORE if folder == ROOT else sources(folder)
    imported = {found.top for path in files for found in outside(path)} - {own}
    origins = {top: {normal(name) for name in provided.get(top, [top])} for top in imported}  # torch need not be there
    available = dependencies(folder) | (dependencies(ROOT) if "omnilab" in dependencies(folder) else set())
    assert {top for top, origin in origins.items() if not origin & available} == set()
    assert dependencies(folder, but=("all", *ENGINES)) - set().union(*origins.values()) - IMPORTED_BY_OTHERS == set()


IMPORTED_BY_OTHERS = {"python-multipart"}  # by FastAPI, which reads forms with it but does not ask for it
ENGINES = ("joblib", "submitit", "ray", "optuna", "docs")  # extras of plugins, which Hydra and MkDocs import


def dependencies(folder: Path, but: tuple[str, ...] = ("all",)) -> set[str]:
    """Also those of extras, but for the extra `all`, which names the plugins."""
    extras = project(folder).get("optional-dependencies", {})
    lines = [*project(folder)["dependencies"], *(line for name in extras if name not in but for line in extras[name])]
    return {normal(re.split(r"[ \[<>=~!;]", line)[0]) for line in lines}


def normal(name: str) -> str:
    """A distribution's name as the index compares it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


@pytest.mark.parametrize("plugin", PLUGINS, ids=names(PLUGINS))
def test_importing_a_plugin_imports_no_heavy_library(plugin: Path) -> None:
    """Followed through the plugin's own modules, from its entry point; a module is imported after its packages."""
    waiting, seen = [f"omnilab_{plugin.name}"], set[str]()
    while waiting:
        module = waiting.pop()
        seen.add(module)
        path = file_of(module)
        assert path is not None, f"{module} has no file"
        now = [found for found in outside(path) if not found.lazy]
        assert not {found.top for found in now} & HEAVY, f"{module} is imported with the plugin"
        own = {found.module for found in now if found.top == f"omnilab_{plugin.name}"}
        waiting += {package for name in own for package in with_packages(name)} - seen


def with_packages(module: str) -> Iterator[str]:
    """A module and the packages that it lies in."""
    while module:
        yield module
        module = module.rpartition(".")[0]


def test_omnilab_all_names_every_plugin() -> None:
    assert sorted(project(ROOT)["optional-dependencies"]["all"]) == sorted(project(p)["name"] for p in PLUGINS)
