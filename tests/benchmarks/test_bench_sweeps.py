"""What a job takes before its study begins; eight equal jobs, one after the other and in two workers; a study in two shards."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import pytest

from omnilab.errors import DataError
from omnilab.runner import hydra_app
from omnilab.runner.build import build
from omnilab.runner.execute import execute
from omnilab.runner.overrides.composition import compose_job
from omnilab.runner.registry import discover
from omnilab.runner.sweeps import load_sweep

WORLD = Path(__file__).parents[1] / "box_world.yaml"
JOBS = [
    "-m", "experiment=quickstart", "seed=range(0,8)", "study.query_count=100", "study.show=4", "study.step_m=0.5",
    f"sensor.world={WORLD}", "sensor.size=160", "cache=off", "~sinks.rerun",
]  # fmt: skip

GRID = (
    "experiment=grid", "study.step_m=0.2", "study.query_count=1024", "cache=off", "hydra/launcher=basic", "~sinks.rerun",
)  # fmt: skip
VIEW_COUNT = (
    "experiment=view_count", "study.seeds=16", "study.fewer_seeds={view_graph:4}", "study.counts=[8,32]",
    "hydra/launcher=basic", "~sinks.rerun",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.benchmark(group="a sweep of eight jobs", timer=time.perf_counter)
@pytest.mark.parametrize(
    "launcher", [[], ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]], ids=["serial", "joblib"]
)
def test_sweep_of_eight_jobs(benchmark, measured, omnilab_in, tmp_path, launcher):
    benchmark.extra_info.update(what=launcher[0] if launcher else "one after the other", peer=not launcher)
    result = benchmark.pedantic(omnilab_in, (tmp_path, *JOBS, *launcher), {"timeout": 800}, rounds=1)
    assert result.rc == 0, result.stderr
    assert len(list(tmp_path.glob("logs/quickstart/*/[0-7]/metrics.csv"))) == 8


@dataclass
class Begun:
    """A study that ends as it begins."""

    needs = ()

    def run(self, parts, log, rng):
        raise DataError("it has begun")


@pytest.mark.benchmark(group="a job in a warm worker")
@pytest.mark.parametrize("what", ["composed, built, its folder and logs made and ended", "composed"])
def test_start_of_a_job(benchmark, tmp_path, what):
    registry, folders = discover(""), (tmp_path / str(number) for number in count())

    def start():
        config, _ = compose_job(["experiment=quickstart", "cache=off", f"logs={tmp_path}"], registry)
        run = build(config, registry)
        run.study = Begun()
        with suppress(DataError):
            execute(run, next(folders), registry)

    def compose():
        compose_job(["experiment=quickstart"], registry)

    benchmark.extra_info.update(what=what, peer=what == "composed")
    benchmark.pedantic(compose if what == "composed" else start, rounds=9, warmup_rounds=2)


@pytest.mark.slow
@pytest.mark.timeout(3000)
@pytest.mark.benchmark(group="a study in two shards", timer=time.process_time)
@pytest.mark.parametrize("words", [GRID, VIEW_COUNT], ids=["grid", "view_count"])
def test_two_shards(benchmark, measured, omnilab_here, monkeypatch, words):
    """Processor time, which other load disturbs least: what two cores allow is half of the whole run's. In shards it takes
    the longest share of each stage and the merging; jobs run in this process, warm, as in a worker after its first job."""
    benchmark.extra_info.update(what=f"{words[0]} as a whole")
    spent: list[float] = []
    run = hydra_app._run

    def timed(*arguments, **named):
        start = time.process_time()
        try:
            return run(*arguments, **named)
        finally:
            spent.append(time.process_time() - start)

    monkeypatch.setattr(hydra_app, "_run", timed)
    assert (
        omnilab_here(*words, "hydra.run.dir=warm", "study.query_count=64" if words is GRID else "study.seeds=4").rc == 0
    )
    spent.clear()
    assert benchmark.pedantic(omnilab_here, (*words, "hydra.run.dir=w"), rounds=1).rc == 0
    assert omnilab_here(*words, "hydra.sweep.dir=s", "shards=2").rc == 0
    whole_s, *jobs_s = spent
    stages = [job.settings["shard"].split("-")[0] for job in load_sweep("s").jobs]
    longest = {
        stage: max(s for own, s in zip(stages, jobs_s, strict=True) if own == stage) for stage in dict.fromkeys(stages)
    }
    merged = load_sweep("s").jobs[-1].folder
    assert (merged / "metrics.csv").read_bytes() == Path("w/metrics.csv").read_bytes()
    benchmark.extra_info.update(
        {"whole_cpu_s": whole_s, **{f"{stage}_cpu_s": s for stage, s in longest.items()},
         "of_what_two_cores_allow": whole_s / 2 / sum(longest.values())}
    )  # fmt: skip
