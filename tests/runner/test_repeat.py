"""The same configuration and seed give the same bytes: alone, in a sweep, and by `omnilab repeat`."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from omnilab_studies import Grid

pytestmark = pytest.mark.slow  # whole runs, each in a process of its own
WORLD = Path(__file__).parents[1] / "box_world.yaml"
SMALL = [
    "experiment=quickstart", f"sensor.world={WORLD}", "sensor.size=96", "sensor.samples=1", "descriptor.offsets=48",
    "descriptor.angles=60", "study.step_m=0.5", "study.query_count=40", "study.show=2",
]  # fmt: skip
NO_LOGS = ["~sink@sinks.rerun", "~sink@sinks.mcap"]
COMPARED = ("metrics.csv", "queries.csv")


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    return tmp_path_factory.mktemp("repeat")


@pytest.fixture(scope="module")
def alone(omnilab_in, here):
    result = omnilab_in(here, *SMALL, "seed=1")
    assert result.rc == 0, result.stderr
    return (here / "logs" / "latest").resolve()


@pytest.fixture(scope="module")
def jobs(omnilab_in, here):
    """Seeds 0 and 1, in one process without logs whose math libraries were told to use another number of threads."""
    logs, env = here / "swept", {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "7"}
    result = omnilab_in(here, "-m", *SMALL, "seed=0,1", f"logs={logs}", *NO_LOGS, env=env)
    assert result.rc == 0, result.stderr
    (folder,) = (logs / "quickstart").iterdir()
    return [folder / "0", folder / "1"]


def bytes_of(folder):
    return [(folder / name).read_bytes() for name in COMPARED]


def test_a_sweep_gives_the_bytes_of_a_run_alone(alone, jobs):
    assert bytes_of(jobs[1]) == bytes_of(alone)


def test_another_seed_gives_another_result(alone, jobs):
    assert all(other != mine for other, mine in zip(bytes_of(jobs[0]), bytes_of(alone), strict=True))


def described(folder, names=("described", "taken from the cache")):
    """How many images a run described, and how many it had from the cache."""
    with (folder / "cost.csv").open(newline="") as stream:
        costs = {row["cost"]: row["value"] for row in csv.DictReader(stream)}
    return [int(costs[name]) for name in names if name in costs]


def rendered(folder):
    """How many images a run rendered, and how many it had from the cache."""
    return described(folder, ("rendered", "renderings taken from the cache"))


def test_a_run_gives_the_same_bytes_with_a_cold_cache_with_a_warm_one_and_without(alone, here, omnilab_here, tmp_path):
    cold = described(alone)
    assert cold[0] > 40
    assert cold[1] == 0
    for setting, expected in (f"cache={here}/logs/cache", cold[::-1]), ("cache=off", []), ("cache=null", []):
        assert omnilab_here(*SMALL, "seed=1", setting, *NO_LOGS).rc == 0
        folder = (tmp_path / "logs" / "latest").resolve()
        assert described(folder) == expected
        assert rendered(folder) == ([0, sum(rendered(alone))] if expected else [])
        assert bytes_of(folder) == bytes_of(alone)
    assert not (tmp_path / "logs" / "cache").exists()


def test_a_sweep_over_distances_renders_and_describes_once(omnilab_here, tmp_path):
    assert omnilab_here("-m", *SMALL, "distance=poc_band,poc,euclidean", *NO_LOGS).rc == 0
    (folder,) = (tmp_path / "logs" / "quickstart").iterdir()
    first, *others = [described(folder / job) for job in "012"]
    assert first[1] == 0
    assert others == [first[::-1]] * 2
    assert [rendered(folder / job)[0] for job in "12"] == [0, 0]


def test_a_study_of_costs_describes_each_time(omnilab_here, tmp_path, monkeypatch):
    monkeypatch.setattr(Grid, "cached", False, raising=False)
    assert omnilab_here(*SMALL, *NO_LOGS).rc == 0
    assert described((tmp_path / "logs" / "latest").resolve()) == []
    assert rendered((tmp_path / "logs" / "latest").resolve())[0] > 0


def test_repeat_gives_the_same_bytes_and_says_so(alone, here, omnilab_here, monkeypatch):
    before = set(alone.parent.iterdir())
    monkeypatch.chdir(here)
    result = omnilab_here("repeat", str(alone))
    assert result.rc == 0
    assert "the metrics are the same" in result.stderr
    (again,) = set(alone.parent.iterdir()) - before
    assert bytes_of(again) == bytes_of(alone)
    assert (again / "config.yaml").read_bytes() == (alone / "config.yaml").read_bytes()

    lines = (again / "metrics.csv").read_text().splitlines()
    (again / "metrics.csv").write_text(
        "\n".join([*lines[:-1], ""])
    )  # as a version wrote it that did not measure the last
    result = omnilab_here("repeat", str(again))
    assert result.rc == 0
    assert f"bit for bit; {lines[-1].partition(',')[0]} were not measured then" in result.stderr


def test_repeat_names_the_metrics_that_differ(jobs, here, omnilab_here, monkeypatch):
    """The least step that a float can make is seen."""
    file = jobs[0] / "metrics.csv"
    monkeypatch.chdir(here)
    with file.open(newline="") as stream:
        rows = list(csv.reader(stream))
    row = next(row for row in rows if row[0] == "position_error_mean")
    row[1] = repr(float(row[1]) * (1 + 2**-52))
    file.write_text("".join(",".join(row) + "\n" for row in rows))
    result = omnilab_here("repeat", str(jobs[0]))
    assert result.rc == 1
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("omnilab:")]
    assert line.endswith(": position_error_mean")
