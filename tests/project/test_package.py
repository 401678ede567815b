"""What the wheels hold, and that omnilab[all] runs where nothing else is installed."""

from __future__ import annotations

import configparser
import os
import shutil
import subprocess
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from omnilab.api import KINDS

ROOT = Path(__file__).parents[2]
PROJECTS = [ROOT, *sorted(path.parent for path in (ROOT / "plugins").glob("*/pyproject.toml"))]
LEFT_BEHIND = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist", "logs", "tests")
NOT_SHIPPED = {"fidelity.json", "performance.json"}  # the measurements from which pages are made
DOCUMENTS = {
    f"omnilab-0.1.0.data/data/share/doc/omnilab/{name}.md" for name in ("CHANGELOG", "CONTRIBUTING", "SECURITY")
}  # pages of the site
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
    core = {"omnilab": "omnilab", "conf": "omnilab/conf", "docs": "omnilab/docs"}
    packages = core if folder == ROOT else {f"omnilab_{folder.name}": ""}
    files = set()
    for package, name in packages.items():
        for path in (folder / package).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts and path.name not in NOT_SHIPPED:
                files.add(f"{name or package}/{path.relative_to(folder / package).as_posix()}")
    return files


@pytest.mark.slow
@pytest.mark.parametrize("folder", PROJECTS, ids=["omnilab", *(folder.name for folder in PROJECTS[1:])])
def test_a_wheel_holds_the_files_of_its_distribution_and_no_others(folder: Path, wheels: Path) -> None:
    with wheel_of(folder, wheels) as wheel:
        assert {name for name in wheel.namelist() if ".dist-info/" not in name} == shipped(folder) | (
            DOCUMENTS if folder == ROOT else set()
        )
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
def test_a_wheel_runs_for_once_without_being_installed(wheels: Path, tmp_path: Path) -> None:
    (core,) = wheels.glob("omnilab-*.whl")
    command = [str(UV), "tool", "run", "--find-links", str(wheels), "--from", str(core), "omnilab"]
    listed = subprocess.run(
        [*command, "--help"], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
    )
    assert listed.returncode == 0, listed.stderr
    assert "\nsink: console\n" in listed.stdout
    refused = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert refused.returncode == 2
    assert "; pip install 'omnilab[all]'" in refused.stderr


@pytest.fixture(scope="module")
def commands(wheels: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the commands of an environment in which omnilab[all] alone is installed, from the wheels."""
    (core,) = wheels.glob("omnilab-*.whl")
    folder = tmp_path_factory.mktemp("environment")
    uv("venv", "--python", "3.11", folder / "venv", cwd=folder)
    python = folder / "venv/bin/python"
    uv("pip", "install", "--python", python, "--find-links", wheels, f"omnilab[all] @ {core.as_uri()}", cwd=folder)
    return folder / "venv/bin"


@pytest.fixture
def clean_omnilab(commands: Path, tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """`clean_omnilab(*arguments)`: the command of that environment, in tmp_path."""

    def omnilab(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [commands / "omnilab", *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
        )

    return omnilab


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_omnilab_all_runs_in_an_empty_environment(clean_omnilab: Callable[..., Any], tmp_path: Path) -> None:
    listed = clean_omnilab("plugins")
    assert (listed.returncode, listed.stderr) == (0, "")
    for folder in PROJECTS:
        if folder.name != "serve":  # which has commands and no component
            assert f", {metadata(folder)['name']} {metadata(folder)['version']}\n" in listed.stdout
    assert " | serve | " in clean_omnilab("--help").stdout
    ran = clean_omnilab(
        "study.step_m=1.5", "study.query_count=10", "study.show=2", "sensor.size=64", "sensor.samples=1"
    )
    assert ran.returncode == 0, ran.stderr
    assert {"metrics.csv", "run.rrd", "run.mcap"} <= {path.name for path in (tmp_path / "logs/latest/").iterdir()}


MADE = """\
from omnilab.api import KINDS
from omnilab.runner.authoring.new import new

for kind in KINDS:
    new([kind, f"my_own_{kind}"])
"""
RUNS_OF_MADE = [
    [
        "sensor=my_own_sensor", "sensor.rows=32", "disturbance=my_own_disturbance", "descriptor=my_own_descriptor",
        "distance=my_own_distance", "localizer=my_own_localizer", "+sink@sinks.mine=my_own_sink",
        "study.step_m=1", "study.query_count=10", "study.show=2",
    ],
    ["study=altitude", "altimeter=my_own_altimeter", "study.position_count=1", "sensor.size=64", "sensor.samples=1"],
    [
        "study=trajectory", "odometry=my_own_odometry", "loop_closure=my_own_loop_closure", "backend=gtsam_isam2",
        "sensor.size=64", "sensor.samples=1",
    ],
    ["experiment=pose_graph", "backend=my_own_backend"],
    ["study=view_range", "view_filter=my_own_view_filter", "study.seeds=2", "study.ranges_m=[6]"],
    ["study=my_own_study", "sensor.size=64", "sensor.samples=1"],
    ["experiment=my_own_study", "sensor.size=64", "sensor.samples=1"],
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_what_new_makes_of_each_kind_is_installed_tested_and_run_there(
    commands: Path, clean_omnilab: Callable[..., Any], tmp_path: Path
) -> None:
    python = commands / "python"
    subprocess.run([python, "-c", MADE], cwd=tmp_path, check=True, capture_output=True, timeout=120)
    folders = sorted(tmp_path.glob("omnilab-my-own-*"))
    assert len(folders) == len(KINDS)
    uv("pip", "install", "--python", python, "pytest", *folders, cwd=tmp_path)
    tests = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-W", "error", *folders]
    done = subprocess.run(tests, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    listed = clean_omnilab("plugins")
    assert (listed.returncode, listed.stderr) == (0, "")
    for kind in KINDS:
        assert f"  my_own_{kind}  omnilab_my_own_{kind}." in listed.stdout
    for arguments in RUNS_OF_MADE:
        ran = clean_omnilab(*arguments, "~sinks.rerun", "~sinks.mcap")
        assert ran.returncode == 0, f"{arguments}: {ran.stderr}"
