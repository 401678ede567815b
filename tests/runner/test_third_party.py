"""A descriptor of someone else, as a distribution and as a single file. README's "add your own" shows that file."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omnilab.testing import check_descriptor

SOURCE = Path(__file__).parents[1] / "third_party"
SMALL = (
    "experiment=quickstart", "study.step_m=1.5", "study.query_count=10", "study.show=2", "sensor.size=64",
    "sensor.samples=1", "~sinks.rerun", "~sinks.mcap",
)  # fmt: skip


@pytest.fixture(scope="module")
def tiny_installed(installed: Callable[[Path], Path]) -> Path:
    """A folder for PYTHONPATH in which the distribution is installed."""
    return installed(SOURCE)


@pytest.fixture
def with_tiny(omnilab: Callable[..., Any], tiny_installed: Path) -> Callable[..., Any]:
    """The command line with the distribution installed."""
    return lambda *arguments: omnilab(*arguments, env={"PYTHONPATH": str(tiny_installed)})


def test_the_distribution_is_listed_with_its_origin(with_tiny: Callable[..., Any]) -> None:
    rc, out, err = with_tiny("plugins")
    assert (rc, err) == (0, "")
    assert "  tiny  omnilab_tiny.Tiny, omnilab-tiny 1.0\n" in out
    assert "The panorama as a tiny image" in out


@pytest.mark.slow
def test_it_runs_with_its_own_default_distance(with_tiny: Callable[..., Any], tmp_path: Path) -> None:
    rc, _, err = with_tiny(*SMALL, "descriptor=tiny", "descriptor.columns=64")
    assert rc == 0, err
    manifest = json.loads((tmp_path / "logs/latest/manifest.json").read_text())
    assert manifest["components"]["descriptor"] == {
        "name": "tiny",
        "class": "omnilab_tiny.Tiny",
        "distribution": "omnilab-tiny",
        "version": "1.0",
    }
    assert manifest["components"]["distance"]["name"] == "poc"
    metrics = {row["metric"]: row["value"] for row in read_csv(tmp_path / "logs/latest/metrics.csv")}
    assert float(metrics["queries"]) == 10
    assert float(metrics["bytes_per_place"]) == 8 * 64 * 4


@pytest.mark.slow
def test_it_is_swept_beside_ours(with_tiny: Callable[..., Any], tmp_path: Path) -> None:
    rc, _, err = with_tiny("-m", *SMALL, "descriptor=radon,tiny")
    assert rc == 0, err
    (summary,) = (tmp_path / "logs").rglob("summary.csv")
    rows = read_csv(summary)
    assert [(row["descriptor"], row["status"]) for row in rows] == [("radon", "done"), ("tiny", "done")]
    assert [float(row["bytes_per_place"]) for row in rows] == [173 * 180 * 4, 8 * 32 * 4]
    distances = [json.loads((summary.parent / job / "manifest.json").read_text()) for job in ("0", "1")]
    assert [manifest["components"]["distance"]["name"] for manifest in distances] == ["poc_band", "poc"]


def test_a_single_file_does_as_well(
    omnilab_here: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = shutil.copy(SOURCE / "omnilab_tiny.py", tmp_path / "mine.py")
    monkeypatch.setenv("OMNILAB_PLUGINS", file.name)
    rc, _, err = omnilab_here(*SMALL, "descriptor=tiny")
    assert rc == 0, err
    descriptor = json.loads((tmp_path / "logs/latest/manifest.json").read_text())["components"]["descriptor"]
    assert (descriptor["name"], descriptor["distribution"]) == ("tiny", file.name)


@pytest.fixture
def tiny(imported: Callable[[Path], Any]) -> Any:
    """The class, imported from its file."""
    return imported(SOURCE / "omnilab_tiny.py").Tiny


@pytest.mark.parametrize("settings", [{}, {"rows": 5, "columns": 16}, {"rows": 1, "columns": 4}])
def test_it_keeps_the_contract(tiny: Any, settings: dict[str, int]) -> None:
    check_descriptor(tiny(**settings))


def test_it_averages_cells(tiny: Any) -> None:
    image = np.array([[[0, 100, 8, 10], [50, 50, 12, 10]]], np.uint8)
    assert tiny(rows=1, columns=2).describe(image).place.tolist() == [[[50.0, 10.0]]]


def test_it_is_as_short_as_promised() -> None:
    files = (SOURCE / "pyproject.toml", SOURCE / "omnilab_tiny.py")
    assert sum(bool(line.strip()) for file in files for line in file.read_text().splitlines()) <= 22


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
