"""Whether the words of a command could do harm, where they may be a stranger's."""

from __future__ import annotations

import re
from dataclasses import fields
from typing import Any

from omnilab.api import KINDS
from omnilab.runner.config import Settings
from omnilab.runner.registry import Registry

NUMBERS = (  # settings of launchers and sweepers that name neither code nor commands of a shell
    "n_jobs", "n_trials", "max_batch_size", "max_failure_rate", "seed", "direction", "timeout_min", "cpus_per_task", "nodes",
    "gpus_per_node", "tasks_per_node", "mem_gb", "partition", "qos", "account", "array_parallelism", "num_cpus", "num_gpus",
)  # fmt: skip
PLAIN = re.compile(
    rf"[+]{{0,2}}hydra/(launcher|sweeper|sweeper/sampler)=\w+|[+]{{0,2}}hydra\.(launcher|sweeper)(\.[a-z]+)*\.({'|'.join(NUMBERS)})=[\w.+-]+"
)
OF_HYDRA = re.compile(
    r"([+~]*|.*@)hydra(?!\w)"
)  # a key: of its own settings, as a whole or as the place of a component
ELSEWHERE = re.compile(r"[\"']?(/|~|(.*/)?\.\.(/|$))")  # a value: a path out of the folder that it is meant from


def doubt(word: str, registry: Registry) -> str | None:
    """Why a word of a command might be a stranger's; None of one that could do no harm.

    Hydra inserts what `${...}` names, recipes and its own settings name code, and some settings name what is written.
    """
    key, _, value = word.partition("=")
    if "${" in word or (OF_HYDRA.match(key) and not PLAIN.fullmatch(word)):
        return "by which Hydra could be made to read or run anything"
    if word.startswith("-") and word not in ("-m", "--multirun"):
        return "by which Hydra could be made to read recipes of anybody"
    if is_choice(key) and re.search(r"(^|[/,\[ \"'])\.\.?/|[=,\[ \"']/", f"={value}"):
        return "by which Hydra could be made to read recipes of anybody"
    if re.split(r"[.+~]", key)[-1] in written_settings(registry) and ELSEWHERE.match(value):
        return "which is written to, and lies elsewhere"
    return None


def is_choice(key: str) -> bool:
    """Whether what stands before the = chooses an experiment or a component, which Hydra finds by name."""
    return re.split(r"[@/]", key.lstrip("+~"))[0] in {"experiment", *KINDS}


def written_settings(registry: Registry) -> set[str]:
    """The names of settings that name a file or a folder which is written."""
    classes: list[type[Any]] = [Settings, *(component.cls for component in registry.components.values())]
    return {each.name for cls in classes for each in fields(cls) if "writes" in each.metadata}
