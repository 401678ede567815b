"""Hydra's loader, so that a recipe runs with another sensor than its own: `experiment=square sensor=equirectangular`.

A recipe sets its components, and a component that the command chooses instead may lack some of these settings.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from functools import cache
from typing import Any

from hydra._internal import hydra as hydra_internals
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_repository import IConfigRepository
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.default_element import GroupDefault, ResultDefault
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.plugins.config_source import ConfigResult
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from omnilab.api import KINDS
from omnilab.runner.plugins.config_nodes import store_components
from omnilab.runner.plugins.recipe_source import add_recipes
from omnilab.runner.registry import Registry

log = logging.getLogger("omnilab")


class RecipeLoader(ConfigLoaderImpl):
    """Leaves out, and says so, what a recipe sets of its own component and the one that the command chooses has not.

    What no component of that kind has stays, for Hydra to refuse it: it is misspelt.
    """

    registry = Registry()  # whose plugins' recipes there are
    _named: frozenset[str] = frozenset()  # what the command names
    _chosen: Mapping[str, str] = {}  # the component that it chooses for each of its slots
    _study: str = ""  # that runs
    _looked_at: tuple[list[str], DictConfig | None] = ([], None)  # what was composed to see the mode, of which words

    def __init__(self, config_search_path: ConfigSearchPath) -> None:
        folders = [(plugin.distribution, folder) for folder, plugin in self.registry.folders.items()]
        add_recipes(config_search_path, folders)
        super().__init__(config_search_path)

    def _load_configuration_impl(
        self,
        config_name: str | None,
        overrides: list[str],
        run_mode: RunMode,
        from_shell: bool = True,
        validate_sweep_overrides: bool = True,
    ) -> DictConfig:
        """Hydra composes to see whether a recipe chooses its mode, then again with the mode as a word more: once is enough."""
        self._named = frozenset(word.partition("=")[0] for word in overrides)
        if not validate_sweep_overrides:
            looked_at = super()._load_configuration_impl(config_name, overrides, RunMode.RUN, from_shell, False)
            self._looked_at = [*overrides], looked_at
            return looked_at
        (words, config), self._looked_at = self._looked_at, ([], None)
        mode = f"hydra.mode={run_mode.name}"
        if config is None or [*words, mode] != overrides:
            return super()._load_configuration_impl(config_name, overrides, run_mode, from_shell)
        self.validate_sweep_overrides_legal(OverridesParser.create().parse_overrides(overrides), run_mode, from_shell)
        config.hydra.mode = run_mode
        config.hydra.overrides.hydra.append(mode)
        return config

    def _compose_config_from_defaults_list(self, defaults: list[ResultDefault], repo: IConfigRepository) -> DictConfig:
        paths = {str(each.package): str(each.config_path) for each in defaults}
        self._chosen = {slot: paths[slot].partition("/")[2] for slot in KINDS if slot in self._named & paths.keys()}
        self._study = paths.get("study", "").partition("/")[2]
        return super()._compose_config_from_defaults_list(defaults, repo)

    def _load_single_config(self, default: ResultDefault, repo: IConfigRepository) -> ConfigResult:
        loaded = super()._load_single_config(default, repo)
        if not str(default.config_path).startswith("experiment/"):
            return loaded
        if isinstance(loaded.config, DictConfig) and _study_of(loaded) not in {None, self._study}:
            self._leave_out_study(loaded.config, str(default.config_path))
        for slot, name in self._chosen.items():
            if foreign := _foreign(loaded.config, slot, name):
                for key in foreign:
                    del loaded.config[slot][key]
                listed = ", ".join(f"{slot}.{key}" for key in foreign)
                _say_once(f"{default.config_path} sets {listed}, which {slot}={name} does not have: left out")
        return loaded

    def _leave_out_study(self, recipe: DictConfig, path: str) -> None:
        """Settings of a study are of that one alone: another may have some of the same name that mean something else."""
        if settings := recipe.pop("study", None):
            listed = ", ".join(f"study.{key}" for key in settings)
            if "experiment" in self._named:  # of which nobody speaks, nothing is said
                _say_once(f"{path} sets {listed} of its own study; study={self._study} has its own: left out")


def _study_of(recipe: ConfigResult) -> str | None:
    """The study that a recipe itself chooses."""
    chosen = [each for each in recipe.defaults_list or () if isinstance(each, GroupDefault)]
    return next((str(each.value) for each in chosen if str(each.group).lstrip("/") == "study"), None)


def _foreign(recipe: Any, slot: str, name: str) -> list[str]:
    """What a recipe sets in a slot and other components of its kind have, but not the one of that name."""
    settings = recipe[slot] if isinstance(recipe, DictConfig) and slot in recipe else None
    if not isinstance(settings, DictConfig):
        return []
    store = ConfigStore.instance().repo.get(slot, {})
    known = {file.removesuffix(".yaml"): set(OmegaConf.create(each.node)) for file, each in store.items()}
    every = set().union(*known.values())
    return [str(key) for key in settings if name in known and key in every - known[name]]


@cache
def _say_once(sentence: str) -> None:
    log.warning("%s", sentence)


def use_recipe_loader(registry: Registry) -> None:
    """Have Hydra find these components, and make this loader from now on, with these recipes; it has no setting for that."""
    store_components(registry)
    RecipeLoader.registry = registry
    vars(hydra_internals)["ConfigLoaderImpl"] = RecipeLoader
