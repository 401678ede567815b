"""The work of a study that several runs may do together, in shards."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import ClassVar

from omnilab.api.data import Array

Batch = Mapping[str, Array]  # arrays by name; batches are joined along the first axes of those that they have


class Shards:
    """The share of a study's work that is done here: all of it.

    A study that can be split declares its stages, `shard_stages: ClassVar[tuple[str, ...]]`, and takes the results of each
    from `work`. In a run that is one shard of many, `work` computes a contiguous share of one stage, keeps it and ends the
    study; in the run that merges them it computes nothing: what follows is the same code, on the same numbers.
    """

    merges: ClassVar[bool] = (
        False  # whether the results of every stage come from elsewhere: then none needs preparation
    )

    def check(self, stage: str, count: int, at_once: int = 1) -> None:
        """ConfigError if the `count` units of a stage, `at_once` of which stay together, are fewer than its shards."""

    def work(
        self, stage: str, count: int, compute: Callable[[int, int], Iterator[Batch]], at_once: int = 1
    ) -> Iterator[Batch]:
        """The results of units 0 to `count`, in order, as batches of plain arrays of numbers or texts.

        `compute(first, last)` makes those of units first to last. The share of a shard begins with a multiple of `at_once`.
        """
        del stage, at_once
        yield from compute(0, count)
