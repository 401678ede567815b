"""Sweeps that are killed at any instant and resumed come to what one comes to that was left alone."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from random import Random

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from sweep_killing import LAUNCHERS, PLUGIN, killed, left_alone, without_wait

pytestmark = pytest.mark.slow
VALUES = "study.value=range(0,4)"
MODULES = {"joblib": "joblib", "submitit": "submitit", "ray": "ray"}


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    return without_wait(left_alone(tmp_path_factory.mktemp("killing") / "alone", VALUES, "serial", 0.0))


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("launcher", "whole"),
    [*((launcher, True) for launcher in LAUNCHERS), ("joblib", False), ("submitit", False)],
    ids=lambda value: value if isinstance(value, str) else "all" if value else "parent",
)
def test_a_killed_sweep_ends_as_one_that_was_left_alone(expected, tmp_path, launcher, whole):
    if launcher in MODULES:
        pytest.importorskip(MODULES[launcher])
    found = killed(
        tmp_path / "killed",
        VALUES,
        launcher,
        0.5,
        kills=2 if launcher == "serial" else 1,
        random=Random(launcher),
        group=whole,
    )
    assert without_wait(found) == expected


@pytest.mark.parametrize("launcher", ["joblib", "submitit"])
def test_a_worker_that_dies_is_one_failed_job(omnilab_in, tmp_path, launcher):
    pytest.importorskip(MODULES[launcher])
    words = ["-m", "~experiment", "study=work", "~sinks.rerun", "~sinks.mcap", "hydra.sweep.dir=s", "study.wait_s=0.2"]
    result = omnilab_in(
        tmp_path, *words, "study.how=well,die", *LAUNCHERS[launcher][:1],
        env={"OMNILAB_PLUGINS": str(PLUGIN)}, timeout=240,
    )  # fmt: skip
    assert result.rc == 1, result.stderr
    rows = list(csv.DictReader((tmp_path / "s" / "summary.csv").read_text().splitlines()))
    assert [(row["study.how"], row["status"]) for row in rows] == [("well", "done"), ("die", "killed")]
    assert "Traceback" not in result.stderr
