"""The commands of docs/clusters.md: a parallel launcher's results are those of one job after the other, byte for byte."""

from __future__ import annotations

import re
import shlex
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SMALL = [
    "experiment=quickstart", "study.query_count=12", "study.show=4", f"sensor.world={ROOT / 'tests' / 'box_world.yaml'}",
    "sensor.size=96", "sensor.samples=1", "descriptor.offsets=48", "descriptor.angles=60", "study.step_m=1.5",
]  # fmt: skip
DOCUMENT = (ROOT / "docs" / "clusters.md").read_text(encoding="utf-8")


def command(engine: str) -> list[str]:
    """The document's command with a launcher or a sweeper, for a small experiment."""
    (line,) = re.findall(rf"\| `omnilab (-m [^`]*hydra/\w+={engine}\b[^`]*)` \|", DOCUMENT)
    words = [word for word in shlex.split(line) if word != "experiment=grid"]
    return [*words, *(word for word in SMALL if word.split("=")[0] not in line)]


def metrics_of(logs: Path) -> dict[str, bytes]:
    (sweep,) = (logs / "quickstart").iterdir()
    return {path.parent.name: path.read_bytes() for path in sweep.glob("[0-9]*/metrics.csv")}


@pytest.fixture(scope="module")
def serial(omnilab_in, tmp_path_factory):
    here = tmp_path_factory.mktemp("serial")
    result = omnilab_in(here, "-m", "seed=1,2", *SMALL, timeout=600)
    assert result.rc == 0, result.stderr
    found = metrics_of(here / "logs")
    assert len(found) == len(set(found.values())) == 2
    return found


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("launcher", ["joblib", "submitit_local", "ray"])
def test_results_are_those_of_one_job_after_the_other(launcher, serial, omnilab_in, tmp_path):
    if launcher == "ray" and find_spec("ray") is None:
        pytest.skip("ray is not installed: uv sync --group ray")
    result = omnilab_in(tmp_path, *command(launcher), timeout=600)
    assert result.rc == 0, result.stderr
    assert metrics_of(tmp_path / "logs") == serial


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_search_runs_as_shown(omnilab_in, tmp_path):
    shown = [word.replace("n_trials=20", "n_trials=2") for word in command("optuna")]
    result = omnilab_in(tmp_path, *shown, timeout=600)
    assert result.rc == 0, result.stderr
    assert "Optuna minimizes -nearest_rate" in result.stderr
    assert len(metrics_of(tmp_path / "logs")) == 2
    assert list(tmp_path.glob("logs/quickstart/*/optimization_results.yaml"))


def test_every_extra_has_its_command():
    for engine in ("joblib", "submitit_local", "submitit_slurm", "ray", "optuna"):
        assert command(engine)[0] == "-m"
