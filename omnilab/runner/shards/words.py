"""The word `shards=N` of a command: the same run as a sweep over its shards."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from omnilab.errors import ConfigError
from omnilab.runner.overrides.composition import compose, launchers
from omnilab.runner.registry import Registry
from omnilab.runner.shards.shard import shards_of, stages_of

SHARDS = "shards"
MOST = 100_000
BATCH = "hydra.sweeper.max_batch_size"
PARALLEL = ("ray", "joblib")  # launchers that are taken where none is given, if they are installed


def in_shards(argv: Sequence[str], registry: Registry, say: Callable[[str], object]) -> list[str]:
    """The words for Hydra: those of a sweep, stage after stage, where `shards=N` is among them; else the same.

    ConfigError if the run cannot be split so.
    """
    given = [word for word in argv if word.startswith(f"{SHARDS}=")]
    if not given:
        return list(argv)
    of = _number(given)
    kept = [word for word in argv if word not in given]
    if not any(word.startswith("hydra/launcher=") for word in kept):
        launcher = next((name for name in PARALLEL if name in launchers()), "basic")
        say(f"{given[0]}: by hydra/launcher={launcher}")
        kept.append(f"hydra/launcher={launcher}")
    taken = ("resume=", "retry_failed=", "hydra.sweep.dir=")
    composed = compose(
        ["-m", *(w for w in kept if not w.startswith(taken) and w not in ("-m", "--multirun"))], registry
    )
    _check(given[0], kept, composed.swept)
    study = composed.choices.get("study")
    stages = stages_of(registry.get("study", study).cls) if study else ()
    if not stages:
        able = [c.name for c in registry.components.values() if c.kind == "study" and stages_of(c.cls)]
        raise ConfigError(f"{given[0]}: the work of this study cannot be split; that of {', '.join(sorted(able))} can")
    multirun = [] if {"-m", "--multirun"} & {*kept} else ["-m"]
    return [*multirun, *kept, f"shard={','.join(map(str, shards_of(stages, of)))}", f"{BATCH}={of}"]


def _number(given: Sequence[str]) -> int:
    text = given[0].partition("=")[2]
    if len(given) > 1 or not text.isdecimal() or not 1 <= int(text) <= MOST:
        raise ConfigError(
            f"{' '.join(given)} is no number of shards; give one whole number from 1 to {MOST}, as in shards=4"
        )
    return int(text)


def _check(given: str, words: Sequence[str], swept: object) -> None:
    """ConfigError for what splitting a run does not go with."""
    if isinstance(swept, dict) and swept:
        raise ConfigError(
            f"{given} splits one run, and the command varies {', '.join(swept)}; give one value of each, or leave out {SHARDS}="
        )
    for word in words:
        if word.startswith(("objective=", "shard=", BATCH, "hydra/sweeper=")) and word != "hydra/sweeper=basic":
            raise ConfigError(
                f"{given} and {word} do not go together: its jobs are shares of one run; leave out one of them"
            )
