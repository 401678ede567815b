"""A plugin for tests of shards: a study of two stages, the second of which needs all of the first."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnilab import Metric, Report, hookimpl
from omnilab.errors import DataError


@dataclass
class Shares:
    """Draws numbers, each from its own seed, then the distance of each to their sum, which no rounding leaves alone."""

    count: int = 10
    at_once: int = 2
    fail_at: int = -1  # unit of the second stage, unless the file `mended` is there
    needs = ()
    metric_names = "spread", "last"
    shard_stages = "draws", "distances"

    def run(self, parts, record, rng):
        base = int(rng.integers(2**32))

        def draws(first, last):
            for start in range(first, last, self.at_once):
                units = range(start, min(start + self.at_once, last))
                yield {"draw": np.array([np.random.default_rng([base, k]).random() for k in units])}

        def distances(first, last):
            if first <= self.fail_at < last and not Path("mended").exists():
                raise DataError("this share was told to fail; mend it")
            for k in record.track(range(first, last), "distances", last - first, lambda _: 1):
                yield {"distance": np.array([drawn[k] - drawn.sum()]), "name": np.array([f"number {k}"])}

        parts.shards.check("distances", self.count, 1)
        drawn = np.concatenate([b["draw"] for b in parts.shards.work("draws", self.count, draws, self.at_once)])
        batches = list(parts.shards.work("distances", self.count, distances))
        found = np.concatenate([b["distance"] for b in batches])
        names = [name for b in batches for name in b["name"].tolist()]
        metrics = [Metric("spread", float(found.std()), "1"), Metric("last", float(found[-1]), "1")]
        return Report(metrics, {"distances": {"name": names, "distance": found.tolist()}})


@hookimpl
def register_studies(register):
    register("shares", Shares)
