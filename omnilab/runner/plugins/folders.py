"""A folder of recipes and worlds: `experiment/NAME.yaml` and `worlds/NAME.yaml`."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from types import ModuleType

from omnilab.errors import PluginError

RECIPES, WORLDS = "experiment", "worlds"


@dataclass
class Shipped:
    """The folders that a plugin ships, and the files in them by what they are and by name."""

    folders: list[Path] = field(default_factory=list)
    recipes: dict[str, Path] = field(default_factory=dict)
    worlds: dict[str, Path] = field(default_factory=dict)

    def add(self, folder: Path) -> None:
        """Take what a folder holds; PluginError if that is nothing, or has no name that can be given."""
        recipes, worlds = _named(folder / RECIPES, "**/*"), _named(folder / WORLDS, "*")
        if not recipes and not worlds:
            raise PluginError(
                f"it ships the folder {folder}, which {'holds neither' if folder.is_dir() else 'is not there'}; put"
                f" {RECIPES}/NAME.yaml or {WORLDS}/NAME.yaml there (and into a wheel, as package-data in pyproject.toml)"
            )
        for what, found, known in ("recipe", recipes, self.recipes), ("world", worlds, self.worlds):
            if twice := found.keys() & known.keys():
                name = min(twice)
                raise PluginError(f"it ships the {what} '{name}' twice, {known[name]} and {found[name]}; rename one")
            known.update(found)
        self.folders.append(folder)


def own_recipes() -> dict[str, Path]:
    """The recipes of omnilab itself."""
    return _named(Path(str(files("omnilab.conf"))) / RECIPES, "*")


def comment_of(recipe: Path) -> tuple[str, str]:
    """The first line of the comment that a recipe begins with, and the further ones."""
    text = recipe.read_text(encoding="utf-8", errors="replace").partition("\ndefaults:")[0]
    lines = [line.removeprefix("#").strip() for line in text.splitlines() if line.startswith("#")]
    comment = [line for line in lines if not line.startswith("@package")]
    return (comment[0] if comment else "", " ".join(comment[1:]))


def folder_of(folder: object, plugin: ModuleType) -> Path:
    """The folder that a plugin registers, by its path or relative to its module; PluginError for what is no path."""
    if not isinstance(folder, (str, Path)):
        raise PluginError(f"register_folders was given {folder!r}; give the path of a folder")
    module = getattr(plugin, "__file__", None)
    if module is None and not Path(folder).is_absolute():
        raise PluginError(f"it ships the folder {folder}, and has no file beside which that lies; give the whole path")
    return Path(module or "").parent / folder


def _named(folder: Path, pattern: str) -> dict[str, Path]:
    """The YAML files of a folder, by their path in it without the suffix."""
    found = {}
    for file in sorted(folder.glob(pattern)):
        name = file.relative_to(folder).as_posix().removesuffix(file.suffix)
        if file.suffix == ".yml" or (file.suffix == ".yaml" and not re.fullmatch(r"[\w-]+(/[\w-]+)*", name)):
            raise PluginError(f"{file} has an unusable name; use letters, digits, _ and -, and .yaml")
        if file.suffix == ".yaml":
            found[name] = file
    return found
