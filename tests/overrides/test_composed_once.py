"""Hydra composes to look for its mode, then for the run: the second time it is given what it composed first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from hydra._internal import config_loader_impl
from hydra._internal.hydra import Hydra
from hydra._internal.utils import create_config_search_path
from hydra.core.global_hydra import GlobalHydra
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

import omnilab.runner.config  # noqa: F401  which puts the slots of a run where Hydra finds them
from omnilab.runner.overrides.recipe_loader import RecipeLoader, use_recipe_loader
from omnilab.runner.registry import Registry, discover


@pytest.fixture(scope="module")
def registry() -> Registry:
    return discover("")


@pytest.fixture
def loader(registry: Registry) -> Iterator[RecipeLoader]:
    GlobalHydra.instance().clear()
    use_recipe_loader(registry)
    hydra = Hydra.create_main_hydra2("omnilab", create_config_search_path("pkg://omnilab.conf"))
    assert isinstance(hydra.config_loader, RecipeLoader)
    yield hydra.config_loader
    GlobalHydra.instance().clear()


@pytest.fixture
def composed(monkeypatch: pytest.MonkeyPatch) -> list[None]:
    """An entry for each composition from now on."""
    plain, found = config_loader_impl.create_defaults_list, list[None]()

    def noted(*args: Any, **named: Any) -> Any:
        found.append(None)
        return plain(*args, **named)

    monkeypatch.setattr(config_loader_impl, "create_defaults_list", noted)
    return found


def as_written(config: DictConfig) -> Any:
    """With `${...}` as they are: the name of a run's folder is another each time."""
    return OmegaConf.to_container(config, resolve=False)


def look(loader: RecipeLoader, words: list[str]) -> Any:
    """As Hydra does for the mode."""
    return loader.load_configuration("config", words, RunMode.MULTIRUN, validate_sweep_overrides=False).hydra.mode


@pytest.mark.parametrize("mode", RunMode)
@pytest.mark.parametrize(
    "words", [["experiment=square", "sensor=equirectangular", "seed=3"], ["study=steps", "hydra.job.chdir=false"]]
)
def test_the_second_composition_is_the_first_with_the_mode(
    loader: RecipeLoader, composed: list[None], words: list[str], mode: RunMode
) -> None:
    full = [*words, f"hydra.mode={mode.name}"]
    anew = as_written(loader.load_configuration("config", [*full], mode))
    given = [*words]
    assert look(loader, given) is None
    given.append(full[-1])  # Hydra adds it to the same list
    assert as_written(loader.load_configuration("config", given, mode)) == anew
    assert len(composed) == 2
    assert as_written(loader.load_configuration("config", full, mode)) == anew
    assert len(composed) == 3, "it is given once"


def test_other_words_are_composed_anew(loader: RecipeLoader, composed: list[None]) -> None:
    look(loader, ["seed=3"])
    config = loader.load_configuration("config", ["seed=4", "hydra.mode=RUN"], RunMode.RUN)
    assert config.seed == 4
    assert len(composed) == 2


def test_a_mode_that_was_chosen_is_found(loader: RecipeLoader) -> None:
    assert look(loader, ["hydra.mode=MULTIRUN"]) is RunMode.MULTIRUN


def test_values_of_a_sweep_are_refused_in_a_run(loader: RecipeLoader) -> None:
    look(loader, ["seed=1,2"])
    with pytest.raises(HydraException, match="Ambiguous value"):
        loader.load_configuration("config", ["seed=1,2", "hydra.mode=RUN"], RunMode.RUN)


def test_what_cannot_be_composed_fails_both_times(loader: RecipeLoader) -> None:
    for _ in range(2):
        with pytest.raises(HydraException, match="experiment/nothing"):
            look(loader, ["experiment=nothing"])
        with pytest.raises(HydraException, match="experiment/nothing"):
            loader.load_configuration("config", ["experiment=nothing", "hydra.mode=RUN"], RunMode.RUN)
