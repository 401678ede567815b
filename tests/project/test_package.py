"""What the wheels hold, and that omnilab[all] runs where nothing else is installed."""

from __future__ import annotations

import configparser
import os
import shutil
import subprocess
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PROJECTS = [ROOT, *sorted(path.parent for path in (ROOT / "plugins").glob("*/pyproject.toml"))]
LEFT_BEHIND = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist", "logs", "tests")
UV = os.environ.get("UV") or shutil.which("uv")

pytestmark = pytest.mark.skipif(UV is None, reason="uv is not there to build and install with")


def uv(*arguments: str | Path, cwd: Path) -> None:
    done = subprocess.run([str(UV), *arguments], cwd=cwd, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the wheels of every distribution, built in a copy of the source tree."""
    copy, out = tmp_path_factory.mktemp("build") / "omnilab", tmp_path_factory.mktemp("wheels")
    shutil.copytree(ROOT, copy, ignore=LEFT_BEHIND)
    uv("build", "--all-packages", "--wheel", "--out-dir", out, cwd=copy)
    return out


def metadata(folder: Path) -> dict[str, Any]:
    """The table [project] of a folder's pyproject.toml."""
    return dict(tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"])


def wheel_of(folder: Path, wheels: Path) -> zipfile.ZipFile:
    """The one wheel of a distribution."""
    (file,) = wheels.glob(f"{metadata(folder)['name'].replace('-', '_')}-{metadata(folder)['version']}-*.whl")
    return zipfile.ZipFile(file)


def shipped(folder: Path) -> set[str]:
    """The files that a distribution's wheel must hold, by their path in it."""
    packages = {"omnilab": "omnilab", "conf": "omnilab/conf"} if folder == ROOT else {f"omnilab_{folder.name}": ""}
    files = set()
    for package, name in packages.items():
        for path in (folder / package).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                files.add(f"{name or package}/{path.relative_to(folder / package).as_posix()}")
    return files


@pytest.mark.slow
@pytest.mark.parametrize("folder", PROJECTS, ids=["omnilab", *(folder.name for folder in PROJECTS[1:])])
def test_a_wheel_holds_the_files_of_its_distribution_and_no_others(folder: Path, wheels: Path) -> None:
    with wheel_of(folder, wheels) as wheel:
        assert {name for name in wheel.namelist() if ".dist-info/" not in name} == shipped(folder)
        entry_points = configparser.ConfigParser()
        (table,) = (name for name in wheel.namelist() if name.endswith(".dist-info/entry_points.txt"))
        entry_points.read_string(wheel.read(table).decode())
    assert dict(entry_points["omnilab"]) == metadata(folder)["entry-points"]["omnilab"]


@pytest.mark.slow
def test_recipes_worlds_and_the_mark_of_types_are_among_them(wheels: Path) -> None:
    core = wheel_of(ROOT, wheels).namelist()
    assert {"omnilab/conf/__init__.py", "omnilab/conf/config.yaml", "omnilab/py.typed"} <= set(core)
    assert any(name.startswith("omnilab/conf/experiment/") for name in core)
    mirror = wheel_of(ROOT / "plugins/mirror", wheels).namelist()
    assert any(name.startswith("omnilab_mirror/worlds/") and name.endswith(".yaml") for name in mirror)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_omnilab_all_runs_in_an_empty_environment(wheels: Path, tmp_path: Path) -> None:
    (core,) = wheels.glob("omnilab-*.whl")
    uv("venv", "--python", "3.11", tmp_path / "venv", cwd=tmp_path)
    python = tmp_path / "venv/bin/python"
    uv("pip", "install", "--python", python, "--find-links", wheels, f"omnilab[all] @ {core.as_uri()}", cwd=tmp_path)
    command = tmp_path / "venv/bin/omnilab"

    def omnilab(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [command, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
        )

    listed = omnilab("plugins")
    assert (listed.returncode, listed.stderr) == (0, "")
    for folder in PROJECTS:
        if folder.name != "serve":  # which has commands and no component
            assert f", {metadata(folder)['name']} {metadata(folder)['version']}\n" in listed.stdout
    assert " | serve | " in omnilab("--help").stdout
    ran = omnilab("study.step_m=1.5", "study.query_count=10", "study.show=2", "sensor.size=64", "sensor.samples=1")
    assert ran.returncode == 0, ran.stderr
    assert {"metrics.csv", "run.rrd", "run.mcap"} <= {path.name for path in (tmp_path / "logs/latest/").iterdir()}
