"""What `omnilab new` makes is sound as it is: it is lint-free, registers, keeps its contract, and its types are checked."""

from __future__ import annotations

import importlib
import inspect
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

import omnilab
from omnilab import api
from omnilab.api import KINDS
from omnilab.runner.authoring.rendering import PYTHON, RUNS, NewComponent
from omnilab.runner.registry import discover

ROOT = Path(__file__).parents[2]
BROKEN = {  # a method of each kind, which will return something else than its contract says
    "sensor": "plan", "disturbance": "apply", "descriptor": "describe", "distance": "match", "localizer": "locate",
    "altimeter": "relative", "odometry": "estimate", "loop_closure": "query", "backend": "optimize",
    "view_filter": "know_view", "study": "run", "sink": "repair",
}  # fmt: skip


def run(*command: str | Path, cwd: Path, timeout: float = 120) -> str:
    """What a command prints, if it ends well."""
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=timeout, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("kind", KINDS)
def test_the_tests_of_a_single_file_pass(
    kind: str, single_files: Path, name_of: Callable[[str], str], importable: Callable[[Path], None], tmp_path: Path
) -> None:
    importable(single_files)
    tests = vars(importlib.import_module(f"test_{name_of(kind)}"))
    functions = [function for name, function in tests.items() if name.startswith("test_")]
    assert len(functions) >= 2
    for function in functions:
        function(**({"tmp_path": tmp_path} if "tmp_path" in inspect.signature(function).parameters else {}))


def test_single_files_of_all_kinds_register(
    single_files: Path, name_of: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(single_files)
    registry = discover(",".join(f"{name_of(kind)}.py" for kind in KINDS))
    assert [failure.sentence for failure in registry.failures] == []
    for kind in KINDS:
        assert registry.get(kind, name_of(kind)).cls.__name__ == NewComponent(kind, name_of(kind)).cls


def test_a_distribution_has_the_same_component_and_tests(
    single_files: Path, distributions: Path, name_of: Callable[[str], str]
) -> None:
    for kind in KINDS:
        component = NewComponent(kind, name_of(kind))
        folder, package = distributions / component.distribution, component.package
        alone = (single_files / f"{component.name}.py").read_text()
        packed = (folder / f"src/{package}/{component.name}.py").read_text()
        assert alone.replace("    Register,\n", "").replace("    hookimpl,\n", "").startswith(packed)
        tests = (single_files / f"test_{component.name}.py").read_text()
        imported = f"from {component.name} import {component.cls}\n"
        assert imported in tests
        packed_tests = (folder / f"tests/test_{component.name}.py").read_text()
        assert packed_tests == tests.replace(imported, f"from {package} import {component.cls}\n")
        project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
        assert project["entry-points"]["omnilab"] == {component.name: package}
        assert not re.search("@[A-Z_]+@", (folder / "README.md").read_text())


@pytest.mark.slow  # a process of its own
def test_pytest_alone_passes_in_the_folder_of_a_distribution_that_is_not_installed(
    distributions: Path, name_of: Callable[[str], str]
) -> None:
    folder = distributions / NewComponent("sink", name_of("sink")).distribution
    assert "3 passed" in run(sys.executable, "-m", "pytest", "-p", "no:cacheprovider", cwd=folder)


def test_a_distribution_registers_and_ships_its_recipe(
    distributions: Path, name_of: Callable[[str], str], importable: Callable[[Path], None]
) -> None:
    component = NewComponent("study", name_of("study"))
    source = distributions / component.distribution / "src"
    importable(source)
    package = importlib.import_module(component.package)
    studies, folders = [], []
    package.register_studies(lambda name, cls: studies.append((name, cls.__name__)))
    package.register_folders(folders.append)
    assert studies == [(component.name, component.cls)]
    (recipe,) = (source / component.package / folders[0]).glob("experiment/*.yaml")
    assert recipe.stem == component.name


def test_what_is_made_is_lint_free_and_formatted(single_files: Path, distributions: Path) -> None:
    for command in (["check"], ["format", "--check"]):
        run(sys.executable, "-m", "ruff", *command, "--no-cache", single_files, distributions, cwd=single_files)


def test_there_is_a_run_of_each_kind_for_the_pythons_that_omnilab_has() -> None:
    assert set(RUNS) == set(KINDS) == set(BROKEN)
    own = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert own["requires-python"] == PYTHON


# --------------------------------------------------------------------------------------------------------------- types
def test_all_that_a_plugin_needs_is_importable_from_omnilab() -> None:
    for name in api.__all__:
        assert getattr(omnilab, name) is getattr(api, name)
    assert {"Descriptor", "hookimpl", "Register", "DataError"} <= set(dir(omnilab))
    with pytest.raises(AttributeError, match="no attribute 'Descriptr'"):
        _ = omnilab.Descriptr
    loaded = "import sys, omnilab; print({'numpy', 'hydra', 'pluggy'} & set(sys.modules))"
    assert run(sys.executable, "-c", loaded, cwd=ROOT) == "set()\n"


@pytest.mark.slow
def test_mypy_finds_nothing_in_what_is_made_and_a_wrong_signature_in_each_kind(
    single_files: Path, distributions: Path, name_of: Callable[[str], str], tmp_path: Path
) -> None:
    for kind in KINDS:
        source = (single_files / f"{name_of(kind)}.py").read_text()
        wrong, count = re.subn(rf"(def {BROKEN[kind]}\(.*?\) -> )(.*?):\n", r"\1complex:\n", source, flags=re.DOTALL)
        assert count == 1
        (tmp_path / f"wrong_{kind}.py").write_text(wrong)
    sources = [path / "src" for path in distributions.iterdir()]
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--follow-imports",
        "silent",
        "--cache-dir",
        tmp_path / "cache",
    ]
    done = subprocess.run(
        [*command, single_files, *sources, tmp_path],
        cwd=tmp_path,
        env=os.environ | {"MYPYPATH": str(ROOT)},  # mypy does not follow what an editable installation does
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    errors = [line for line in done.stdout.splitlines() if ": error: " in line]
    assert [line for line in errors if not line.startswith("wrong_")] == []
    for kind in KINDS:
        protocol = "ViewMap" if kind == "view_filter" else "PlaceDatabase" if kind == "loop_closure" else None
        expected = f'variable has type "type[{protocol or KINDS[kind].protocol.__name__}]"'
        assert any(line.startswith(f"wrong_{kind}.py") and expected in line for line in errors), f"{kind}: {errors}"
