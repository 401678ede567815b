"""What differs between runs that are shown together, and the short names by which they can be told apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from omnilab.hooks import RunSummary

OF_NO_RUN = ("sinks", "logs", "cache", "cache_gb", "limits")  # settings that change no result
LONGEST_NAME = 32  # characters
NONE = "-"  # a setting that a run does not have
Settings = Mapping[str, str]


def differences(runs: Sequence[RunSummary]) -> dict[str, list[str]]:
    """The settings that are not the same in all runs: name, and its value in each; of a component, its name first.

    What belongs to components that differ themselves is left out, unless an override names it.
    """
    found = [settings(run) for run in runs]
    names = list(dict.fromkeys(name for each in found for name in each))
    values = {name: [each.get(name, NONE) for each in found] for name in names}
    different = {name: row for name, row in values.items() if len(set(row)) > 1}
    components = {slot for run in runs for slot in run.components if slot in different}
    named = {override.lstrip("+~").partition("=")[0] for run in runs for override in run.overrides}
    own = {name for name in different if any(name.startswith(f"{slot}.") for slot in components)}
    return {name: row for name, row in different.items() if name in named or name not in own}


def settings(run: RunSummary) -> Settings:
    """Experiment, components and settings of a run, as texts by dotted names."""
    components = {slot: name for slot, name in run.components.items() if not slot.startswith("sinks.")}
    leaves = dict(_leaves(run.config, ""))
    kept = {name: text for name, text in leaves.items() if name.partition(".")[0] not in OF_NO_RUN}
    return {"experiment": run.experiment} | components | kept


def _leaves(node: Any, name: str) -> list[tuple[str, str]]:
    if isinstance(node, Mapping):
        return [leaf for key, value in node.items() for leaf in _leaves(value, f"{name}.{key}".lstrip("."))]
    return [(name, NONE if node is None else str(node))]


def short_names(runs: Sequence[RunSummary], different: Mapping[str, Sequence[str]]) -> list[str]:
    """A name for each run that no other has: what is different about it, or else its folder's name, or a number."""
    components = {"experiment"} | {slot for run in runs for slot in run.components}
    names = [""] * len(runs)
    for setting, row in different.items():
        words = row if setting in components else [f"{setting.rpartition('.')[2]}={value}" for value in row]
        longer = [f"{name} {word}".strip() for name, word in zip(names, words, strict=True)]
        if len(set(longer)) > len(set(names)):  # what goes with another difference tells nothing more
            names = longer
    folders = [run.folder for run in runs]
    sweeps = [f"{folder.parent.name}/{folder.name}" for folder in folders]
    for choice in (names, [folder.name for folder in folders], sweeps):
        if len(set(choice)) == len(runs) and max(map(len, choice)) <= LONGEST_NAME:
            return choice
    return [f"{number} {name[:LONGEST_NAME]}" for number, name in enumerate(sweeps, start=1)]
