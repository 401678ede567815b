"""Configurations without a run: what the words of a command come to, and what the builder says of it.

Every mistake is the sentence that the command line would show.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from hydra import initialize_config_module
from hydra._internal.hydra import Hydra
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict, read_write
from omegaconf.errors import OmegaConfBaseException

from omnilab.errors import ConfigError
from omnilab.runner.build import build
from omnilab.runner.config import Run
from omnilab.runner.overrides.command_line import for_hydra
from omnilab.runner.overrides.compose_errors import sentence
from omnilab.runner.overrides.recipe_loader import use_recipe_loader
from omnilab.runner.registry import Registry
from omnilab.runner.sweeps.objective import check_sweep
from omnilab.runner.sweeps.plan_file import count, swept


@dataclass(frozen=True)
class Composition:
    """What an experiment, or the first job of a sweep, is composed of."""

    config: DictConfig  # without Hydra's own settings
    choices: Mapping[str, str | None]  # by group, such as descriptor@descriptors.a
    swept: Mapping[str, Sequence[str]]  # the values of what a sweep varies, by name
    jobs: int
    varied: Sequence[Sequence[str]]  # the overrides of further jobs: each swept value beside the first of the others


def compose(words: Sequence[str], registry: Registry) -> Composition:
    """Compose the words of a command, as a sweep if there is `-m` among them; ConfigError if that cannot be."""
    words = for_hydra(words, registry)
    multirun = "--multirun" in words
    words = [word for word in words if word != "--multirun"]
    with in_sentences(registry, words), _hydra(registry) as hydra:
        config = hydra.compose_config("config", words, RunMode.MULTIRUN if multirun else RunMode.RUN)
        return _sweep(config, registry) if multirun else Composition(*_parted(config), {}, 1, ())


def _sweep(config: DictConfig, registry: Registry) -> Composition:
    check_sweep(config)
    task = list(config.hydra.overrides.task)
    parameters = swept(task, {})
    is_basic = config.hydra.runtime.choices["hydra/sweeper"] == "basic"
    if not is_basic:  # it searches: of what it does not enumerate, there is no first value
        parameters = {name: values for name, values in parameters.items() if len(values) > 1}
    jobs = count(parameters) if is_basic else int(config.hydra.sweeper.get("n_trials") or count(parameters))
    parser = OverridesParser.create(config_loader=GlobalHydra.instance().config_loader())
    fixed = [str(parsed.input_line) for parsed in parser.parse_overrides(task) if not parsed.is_sweep_override()]
    if is_basic and any(p.is_sweep_override() and not p.is_discrete_sweep() for p in parser.parse_overrides(task)):
        raise HydraException("does not support sweep type")
    if not all(parameters.values()):
        raise ConfigError(
            "the sweep has no job: one of its values, such as glob(...), matches nothing; correct that one"
        )
    first = {name: values[0] for name, values in parameters.items()}
    others = [first | {name: value} for name, values in parameters.items() for value in values[1:]]
    jobs_of = [[*fixed, *(f"{name}={value}" for name, value in job.items())] for job in (first, *others)]
    composed = compose_job(jobs_of[0], registry)
    return Composition(*composed, parameters, jobs, jobs_of[1:])


def compose_job(overrides: Sequence[str], registry: Registry) -> tuple[DictConfig, dict[str, str | None]]:
    """The configuration of one job of a sweep, by its overrides as Hydra takes them, and what was chosen."""
    with in_sentences(registry, overrides), _hydra(registry) as hydra:
        return _parted(hydra.compose_config("config", list(overrides), RunMode.RUN))


def check_build(config: DictConfig, registry: Registry) -> Run:
    """Build what was composed, as a run does; ConfigError or DataError if that cannot be."""
    with in_sentences(registry, ()):
        return build(config, registry)


def launchers() -> list[str]:
    """The names of Hydra's launchers that are installed."""
    Plugins.instance()  # which has each register itself
    return sorted(name.removesuffix(".yaml") for name in ConfigStore.instance().repo["hydra"]["launcher"])


def _parted(config: DictConfig) -> tuple[DictConfig, dict[str, str | None]]:
    choices: Any = OmegaConf.to_container(config.hydra.runtime.choices)
    with read_write(config), open_dict(config):
        del config["hydra"]
    return config, choices


@contextmanager
def _hydra(registry: Registry) -> Iterator[Hydra]:
    """Hydra without a command line; as there, it finds the recipes of omnilab and of plugins. It is the process's own meanwhile."""
    own, before = GlobalHydra.instance(), GlobalHydra.instance().hydra
    own.hydra = _made(tuple(registry.folders))
    try:
        yield own.hydra
    finally:
        own.hydra = before


@cache
def _made(folders: tuple[Path, ...]) -> Hydra:  # noqa: ARG001  other folders, other recipes
    GlobalHydra.instance().clear()
    initialize_config_module("omnilab.conf", job_name="omnilab", version_base="1.3")
    made = GlobalHydra.instance().hydra
    assert made is not None
    return made


@contextmanager
def in_sentences(registry: Registry, words: Sequence[str]) -> Iterator[None]:
    """What Hydra and its libraries raise of a configuration that cannot be, as a ConfigError."""
    use_recipe_loader(registry)
    try:
        yield
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigError(sentence(error, registry, words)) from error
    except ValueError as error:
        if "Config group override" not in str(error):
            raise
        raise ConfigError(
            "a slot cannot be set to null; leave a component out with ~SLOT, as in ~descriptor"
        ) from error
    except Exception as error:
        if (mark := getattr(error, "problem_mark", None)) is None:
            raise
        raise ConfigError(f"{mark.name}, line {mark.line + 1}, is no YAML; correct it") from error  # a recipe
