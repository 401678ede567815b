"""Where Hydra finds the recipes of plugins: sources on its search path that hold `experiment/` and nothing else."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra._internal.sources_registry import SourcesRegistry
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.plugins.config_source import ConfigResult
from omegaconf import DictConfig

from omnilab.errors import ConfigError
from omnilab.runner.plugins.folders import RECIPES


class RecipeSource(FileConfigSource):
    """A plugin's folder, of whose files Hydra sees recipes alone: none that would stand for a component or for ours."""

    @staticmethod
    def scheme() -> str:
        return "recipes"

    def is_config(self, config_path: str) -> bool:
        return config_path.startswith(f"{RECIPES}/") and super().is_config(config_path)

    def is_group(self, config_path: str) -> bool:
        return f"{config_path}/".startswith(f"{RECIPES}/") and super().is_group(config_path)

    def load_config(self, config_path: str) -> ConfigResult:
        file = Path(self.path, self._normalize_file_name(config_path))
        try:
            loaded = super().load_config(config_path)
        except UnicodeDecodeError as error:
            raise ConfigError(f"{file} is no text in UTF-8; save it as that") from error
        if not isinstance(loaded.config, DictConfig):
            raise ConfigError(f"{file} is a list, and no settings by name; begin it as other recipes do")
        return loaded

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        return super().list(config_path, results_filter) if self.is_group(config_path) else []


def add_recipes(path: ConfigSearchPath, folders: Iterable[tuple[str, Path]]) -> None:
    """Put folders (who ships them, where) on a search path, behind our own recipes and before the components."""
    SourcesRegistry.instance().register(RecipeSource)
    for provider, folder in folders:
        path.prepend(provider, f"{RecipeSource.scheme()}://{folder}", anchor="schema")
