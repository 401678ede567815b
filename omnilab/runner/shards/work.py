"""What a study is given in a run that is one shard of many, or that merges them."""

from __future__ import annotations

import copy
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from omnilab.api import Batch, Metric, Report, Shards
from omnilab.errors import ConfigError, DataError
from omnilab.runner.config import Run
from omnilab.runner.registry import Registry
from omnilab.runner.run_folder.names import DONE, FAILED
from omnilab.runner.run_folder.origin import commit
from omnilab.runner.shards.part_file import About, joined, read_part, write_part
from omnilab.runner.shards.shard import ALL, Shard, shard_of
from omnilab.runner.sweeps.active import own_overrides
from omnilab.runner.sweeps.identity import job_identity
from omnilab.runner.sweeps.reader import SweepReader
from omnilab.runner.sweeps.state import Job


class ShareDone(BaseException):
    """A shard has done its share: the report of that."""

    def __init__(self, report: Report) -> None:
        super().__init__(report)
        self.report = report


@dataclass(frozen=True)
class JobPlace:
    """Where the job of a sweep stands: its sweep's folder, its own, and its overrides."""

    sweep: Path
    folder: Path
    overrides: Sequence[str]


class OneShard(Shards):
    """Computes a share of one stage, from the results of all shards of the stages before it; or merges all stages."""

    def __init__(self, shard: Shard, place: JobPlace, run: str) -> None:
        """`run` is the identity of the run that is split."""
        self.shard, self.place, self._run, self._commit = shard, place, run, commit()

    @property
    def merges(self) -> bool:  # type: ignore[override]
        return self.shard.stage == ALL

    def check(self, stage: str, count: int, at_once: int = 1) -> None:
        Shard(stage, 1, self.shard.of).share(count, at_once)

    def work(
        self, stage: str, count: int, compute: Callable[[int, int], Iterator[Batch]], at_once: int = 1
    ) -> Iterator[Batch]:
        if stage == self.shard.stage:
            about = self._about(self.shard, count, at_once)
            write_part(self.place.folder, about, joined(compute(about.first, about.last)))
            raise ShareDone(_report(about, stage))
        for number in range(1, self.shard.of + 1):
            shard = Shard(stage, number, self.shard.of)
            yield read_part(self._folder_of(shard), self._about(shard, count, at_once))

    def _about(self, shard: Shard, count: int, at_once: int) -> About:
        return About(str(shard), *shard.share(count, at_once), count, self._run, self._commit)

    def _folder_of(self, shard: Shard) -> Path:
        """The folder of a shard's job; DataError if it is not done."""
        job = self._jobs.get(str(shard))
        if job is None or job.state != DONE:
            state, sweep = ("missing", "") if job is None else (job.state, f" {shlex.quote(str(self.place.sweep))}")
            retry = " --retry-failed" if state == FAILED else ""
            raise DataError(
                f"shard {shard} is {state}; go on with the sweep: omnilab sweep resume{sweep or ' SWEEP'}{retry}"
            )
        return job.folder

    @cached_property
    def _jobs(self) -> dict[str, Job]:
        """The jobs that differ from this one by their shard alone, by that."""
        own = _without_shard(self.place.overrides)
        jobs = SweepReader(self.place.sweep).load().jobs
        return {
            job.settings["shard"]: job
            for job in jobs
            if "shard" in job.settings and _without_shard(job.overrides) == own
        }


def shards_of_job(run: Run, registry: Registry, place: JobPlace | None) -> Shards:
    """The share of the work that a run does; ConfigError for a shard that is no job of a sweep."""
    shard = shard_of(run.shard, run.study)
    if shard is None:
        return Shards()
    if place is None:
        raise ConfigError(
            f"shard={shard} is a job of a sweep, which needs the others; give shards={shard.of} in its place"
        )
    whole = copy.copy(run)
    whole.shard = None
    return OneShard(shard, place, job_identity(whole, registry))


def _without_shard(overrides: Sequence[str]) -> list[str]:
    return [word for word in own_overrides(overrides) if not word.startswith("shard=")]


def _report(about: About, stage: str) -> Report:
    done = about.last - about.first
    text = f"## Shard {about.shard}\n\n{done} of {about.count} {stage}: {about.first} up to {about.last}."
    return Report([Metric(stage, done, "1")], summary=text)
