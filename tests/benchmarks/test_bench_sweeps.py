"""What a sweep of eight equal jobs takes, one after the other and in two workers; once each."""

from __future__ import annotations

from pathlib import Path

import pytest

WORLD = Path(__file__).parents[1] / "box_world.yaml"
JOBS = [
    "-m", "experiment=quickstart", "seed=range(0,8)", "study.query_count=100", "study.show=4", "study.step_m=0.5",
    f"sensor.world={WORLD}", "sensor.size=160", "cache=off", "~sinks.rerun",
]  # fmt: skip


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "launcher", [[], ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]], ids=["serial", "joblib"]
)
def test_sweep_of_eight_jobs(benchmark, measured, omnilab_in, tmp_path, launcher):
    result = benchmark.pedantic(omnilab_in, (tmp_path, *JOBS, *launcher), {"timeout": 800}, rounds=1)
    assert result.rc == 0, result.stderr
    assert len(list(tmp_path.glob("logs/quickstart/*/[0-7]/metrics.csv"))) == 8
