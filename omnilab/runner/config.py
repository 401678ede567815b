"""The configuration of a run: one typed tree, a slot or a dictionary for each kind of component."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, make_dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, get_type_hints

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING, DictConfig, OmegaConf

from omnilab.api import KINDS, setting
from omnilab.errors import ConfigError
from omnilab.runner.registry import DICTS, Registry
from omnilab.runner.shards.shard import ALL


@dataclass
class Settings:
    """The settings of a run beside its components."""

    map: str | None = None  # a map that another run saved, or that run's folder; it brings its descriptor and distance
    seed: int = setting(0, at_least=0, at_most=2**63 - 1)
    threads: int = setting(
        1, at_least=1, at_most=256
    )  # of each matrix product: results are only the same bit for bit with the same number
    device: str = "cpu"  # where descriptions and distances are computed, if they can be: cuda, cuda:1 (docs/gpu.md)
    limits: bool = True  # refuse work beyond the memory and disk that are free, or of more than a day; off: try it
    objective: Any = (
        None  # METRIC, -METRIC or a list of them: what a sweeper is told of the run; null: its first metric
    )
    shard: str | None = None  # the share of the work that a job of `shards=N` does: STAGE-K-of-N
    logs: str = setting("logs", writes=True)  # where run folders go
    cache: str | None = setting(
        "cache", writes=True
    )  # folder of images and descriptions, within `logs` unless absolute; off: render and describe everything anew
    cache_gb: float = setting(4.0, above=0, at_most=1e6)  # at most; then those go that were used longest ago


if TYPE_CHECKING:

    @dataclass
    class Run(Settings):
        """The configuration of a run: its settings, and the slots and dictionaries of `KINDS`."""

        def __getattr__(self, name: str) -> Any: ...
        def __setattr__(self, name: str, value: Any) -> None: ...

else:
    own, types = fields(Settings), get_type_hints(Settings)
    Run = make_dataclass(
        "Run",
        [
            *((kind.name, Any, MISSING if kind.name == "study" else None) for kind in KINDS.values() if kind.slot),
            *((kind.plural, dict[str, Any], field(default_factory=dict)) for kind in KINDS.values() if kind.many),
            *((each.name, types[each.name], field(default=each.default, metadata=each.metadata)) for each in own),
        ],
        namespace={
            "__doc__": "The configuration of a run: its settings, and the slots and dictionaries of `KINDS`.",
            "urls": MappingProxyType({}),  # of settings that are paths of copies, by the settings' paths
        },
    )
    Run.__module__ = __name__

# what config.yaml begins with: every kind is a choice, and none is chosen yet
SLOTS = {"defaults": [{kind.name: None} for kind in KINDS.values() if kind.slot or kind.part]}

OFF = ("off", "false")  # what YAML makes of off

ConfigStore.instance().store(name="omnilab_run", node=Run, provider="omnilab")
ConfigStore.instance().store(name="omnilab_slots", node=SLOTS, provider="omnilab")


def logs_folder(logs: str) -> str:
    """The folder for run folders; ConfigError if it has no name."""
    if not logs.strip():
        raise ConfigError(f"logs='{logs}' names no folder; give logs=DIR, or logs=. for the folder that you are in")
    return logs


def cache_folder(logs: str, cache: str | None) -> Path | None:
    """Where descriptions, renderings and copies of inputs are kept; None if they are not."""
    return None if cache is None or cache.lower() in OFF else Path(logs) / cache


NAMED = 4  # of a sweep over studies, in the name of its folder


def run_name(choices: Mapping[str, Any], overrides: Sequence[str]) -> str:
    """What a run is called, and the folder of its folder: its recipe, or its study where that alone was chosen.

    A sweep over some of them is called by all, as in `grid-steps`.
    """
    given = dict(word.split("=", 1) for word in overrides if "=" in word)
    experiment, study = choices.get("experiment"), choices.get("study")
    chosen = given.get("experiment", given.get("study", ""))
    if re.fullmatch(r"\w+(,\w+)+", chosen):
        first, *others = dict.fromkeys(chosen.split(","))
        return "-".join([first, *(others if len(others) < NAMED else [f"and-{len(others)}-more"])])
    if experiment is None or ("experiment" not in given and given.get("study") == study):
        if study is None:
            raise ConfigError("neither an experiment nor a study is chosen; give experiment=NAME or study=NAME")
        return str(study)
    return str(experiment)


def literal(settings: Any) -> Any:
    """Settings of which OmegaConf inserts nothing: every ${ in a text stands for itself. For what a file says."""
    if isinstance(settings, dict):
        return {name: literal(value) for name, value in settings.items()}
    if isinstance(settings, list):
        return [literal(value) for value in settings]
    return re.sub(r"(\\*)\$\{", r"\1\1\\${", settings) if isinstance(settings, str) else settings


def structured(config: DictConfig) -> Iterator[tuple[str, DictConfig]]:
    """The run and each of its components, with the path before their settings."""
    yield "", config
    for path, _, value in components_of({str(k): config[k] for k in config if not OmegaConf.is_missing(config, k)}):
        if isinstance(value, DictConfig) and is_dataclass(OmegaConf.get_type(value)):
            yield f"{path}.", value


def components_of(settings: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Path, kind and content of every slot of a run's settings, and of every member of its dicts of components."""
    for name, value in settings.items():
        if name in KINDS:
            yield name, name, value
        elif name in DICTS:
            for key, member in value.items():
                yield f"{name}.{key}", DICTS[name], member


def named_components(run: Run, registry: Registry) -> dict[str, dict[str, str]]:
    """For each slot in use: the registered name, class, distribution and version."""
    found: dict[str, dict[str, str]] = {}
    for slot, _, value in components_of(vars(run)):
        if value is None:
            continue
        component = registry.of(value)
        found[slot] = {
            "name": component.name if component else "",
            "class": f"{type(value).__module__}.{type(value).__qualname__}",
            "distribution": component.plugin.distribution if component else "",
            "version": component.plugin.version if component else "",
        }
    return found


def resolved_yaml(run: Run) -> str:
    """The configuration as it ran, defaults and all."""
    return OmegaConf.to_yaml(resolved(run))


def resolved(run: Run) -> DictConfig:
    """All that a run's results depend on, inputs by the URLs that were given; what merges shards is the whole.

    Its objective is the sweeper's business. A run on the processor says nothing of a device, as those of before there were any.
    """
    left_out = {"objective", "urls"} | (set() if run.shard and not run.shard.startswith(ALL) else {"shard"})
    left_out |= {"device"} if run.device == Settings.device else set()
    config = OmegaConf.create({name: _settings(value) for name, value in vars(run).items() if name not in left_out})
    for name, url in run.urls.items():
        OmegaConf.update(config, name, literal(url))
    return config


def _settings(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _settings(member) for name, member in value.items()}
    return OmegaConf.structured(value) if is_dataclass(value) else value
