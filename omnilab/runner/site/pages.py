"""All pages that are made rather than written, and where the navigation has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from omnilab.api import KINDS
from omnilab.runner.registry import Registry
from omnilab.runner.site.components import FOLDERS, component_pages, kinds_index, path_of, title_of_kind
from omnilab.runner.site.recipes import recipe_pages, recipes_index, shipped_recipes
from omnilab.runner.site.reference import MODULES, reference_index, reference_pages
from omnilab.runner.site.texts import Sources, title_of

THEORY = """\
A page for each method, of its docstring: equation and source, settings, code, limits, and the recipes with it.
"""
STUDIES = "A study drives components and measures; a [recipe](../recipes/index.md) picks a study and components.\n"


def made_pages(registry: Registry, docs: Path) -> dict[str, str]:
    """The text of each page, by its path."""
    sources, recipes = Sources(docs), shipped_recipes()
    known = {(each.kind, each.name): path_of(each) for each in registry.components.values()}
    return {
        "theory/index.md": kinds_index(registry, "theory", "Methods", THEORY),
        "studies/index.md": kinds_index(registry, "studies", "Studies", STUDIES),
        "recipes/index.md": recipes_index(recipes),
        "reference/index.md": reference_index(),
        **dict(component_pages(registry, recipes, sources)),
        **dict(recipe_pages(known, recipes, sources)),
        **dict(reference_pages(registry)),
    }


def navigation(entry: str, registry: Registry, made: dict[str, str], elsewhere: dict[str, str]) -> list[Any]:
    """What stands in the navigation for an entry that ends in /."""
    if entry == "theory/":
        kinds = [kind for kind in KINDS if FOLDERS[kind] == "theory"]
        return ["theory/index.md", *({title_of_kind(kind): _of_kind(kind, registry)} for kind in kinds)]
    if entry == "studies/":
        return ["studies/index.md", {"Each study": _of_kind("study", registry)}]
    if entry == "recipes/":
        return [
            "recipes/index.md",
            *({Path(path).stem: path} for path in made if path.startswith(entry) and "index" not in path),
        ]
    if entry == "reference/":
        settings = [f"reference/settings_{kind}.md" for kind in ("run", *KINDS)]
        modules: list[Any] = [{title: f"reference/{name}.md"} for name, (title, _) in MODULES.items()]
        return [
            "reference/index.md",
            {"Python": modules},
            {"Settings": settings},
            {"Sinks": _of_kind("sink", registry)},
        ]
    pages = sorted(path for path in elsewhere if path.startswith(f"{entry}plugin_"))
    return [{title_of(elsewhere[path]): path} for path in pages]


def _of_kind(kind: str, registry: Registry) -> list[dict[str, str]]:
    return [{name: path_of(registry.get(kind, name))} for name in registry.names(kind)]
