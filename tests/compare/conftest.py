"""Run folders that were never run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from omnilab.api import Metric, Report
from omnilab.runner.run_folder import DONE, RunFolder

CONFIG = """\
sensor:
  world: {world}
descriptor:
  angles: {angles}
distance: {{}}
study:
  step_m: {step_m}
sinks:
  console:
    bars: true
seed: {seed}
logs: {logs}
"""


def component(name: str, version: str = "0.1.0", distribution: str = "omnilab-appearance") -> dict[str, str]:
    return {"name": name, "class": f"of.{name}", "distribution": distribution, "version": version}


@pytest.fixture
def made(tmp_path: Path) -> Callable[..., Path]:
    """`made("sweep/0", seed=1, rate=0.5, queries={...})`: the folder of a run, relative to tmp_path."""

    def make(
        name: str,
        *,
        seed: int = 0,
        angles: Any = 180,
        step_m: float = 0.4,
        world: str = "room",
        logs: str = "logs",
        study: str = "grid",
        descriptor: str = "radon",
        version: str = "0.1.0",
        digest: str = "a" * 64,
        overrides: Sequence[str] = (),
        rate: float = 0.5,
        metrics: Sequence[Metric] | None = None,
        queries: Mapping[str, Sequence[Any]] | None = None,
        wall_s: float = 2.0,
        status: str = DONE,
    ) -> Path:
        folder = tmp_path / name
        components = {
            "study": component(study),
            "descriptor": component(descriptor, version),
            "distance": component("poc"),
        }
        manifest = {"experiment": study, "overrides": list(overrides), "seed": seed, "components": components}
        manifest["files"] = {"sensor.world": digest}
        text = CONFIG.format(world=world, angles=angles, step_m=step_m, seed=seed, logs=logs)
        run = RunFolder(folder)
        run.open(manifest, text)
        found = [Metric("nearest_rate", rate, "1", (rate - 0.1, rate + 0.1)), Metric("error_median", 2 * rate, "m")]
        tables = {"queries": queries} if queries is not None else {}
        run.write(Report(found if metrics is None else metrics, tables=tables))
        run.write_costs([("wall", wall_s, "s")])
        run.end(status, **({} if status == DONE else {"error": "DataError: no \x1b[31mimages"}))
        return folder

    return make
