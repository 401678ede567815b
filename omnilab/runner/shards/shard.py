"""The setting `shard`: which share of a run's work a job does."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

from omnilab.errors import ConfigError

ALL = "all"  # in place of a stage: all shards of all stages are merged, `all-4-of-4`
FORM = re.compile(r"([a-z_]+)-(\d{1,6})-of-(\d{1,6})")


class Shard(NamedTuple):
    """A share of a stage, or the merging of all."""

    stage: str
    number: int  # from 1
    of: int

    def __str__(self) -> str:
        return f"{self.stage}-{self.number}-of-{self.of}"

    def share(self, count: int, at_once: int) -> tuple[int, int]:
        """First and last of `count` units: whole groups of `at_once`, as evenly as may be.

        ConfigError if there are fewer groups than shards.
        """
        groups = -(-count // at_once)
        if self.of > groups:
            come = f" come {at_once} at a time, which stay together, in {groups} groups" if at_once > 1 else ""
            smaller = ", or make sensor.batch smaller" if at_once > 1 else ""
            raise ConfigError(
                f"shards={self.of} is more than there is to share: the {count} {self.stage}{come}; give shards={groups} or"
                f" fewer{smaller}"
            )
        first, last = ((self.number - 1) * groups // self.of, self.number * groups // self.of)
        return first * at_once, min(count, last * at_once)


def shard_of(setting: str | None, study: Any) -> Shard | None:
    """The setting, read; None if a run does all its work. ConfigError if the study has no such shard."""
    if setting is None:
        return None
    found = FORM.fullmatch(setting)
    shard = Shard(found[1], int(found[2]), int(found[3])) if found else Shard("", 0, 0)
    if shard.stage not in (*stages_of(study), ALL) or not 1 <= shard.number <= shard.of:
        raise ConfigError(
            f"shard={setting} is none of this study's, which shards=N makes: STAGE-K-of-N; give shards=4, say, in its place"
        )
    return shard


def stages_of(study: Any) -> tuple[str, ...]:
    """The stages of a study whose work can be split, in order; none of one that cannot."""
    return tuple(getattr(study, "shard_stages", ()))


def shards_of(stages: tuple[str, ...], of: int) -> list[Shard]:
    """All jobs of a run in `of` shards, in the order in which they depend on each other."""
    return [*(Shard(stage, k, of) for stage in stages for k in range(1, of + 1)), Shard(ALL, of, of)]
