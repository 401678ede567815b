"""A page for each component, of its docstring: what it is, equation and source, settings, code, and where it is used."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import get_type_hints

from omnilab.api import KINDS
from omnilab.runner.registry import Component, Registry
from omnilab.runner.site.recipes import Recipe
from omnilab.runner.site.texts import Sources, manual, settings_of, table

FOLDERS = dict.fromkeys(KINDS, "theory") | {"study": "studies", "sink": "reference"}
TITLES = {"sensor": "Cameras and recordings", "view_filter": "View filters", "loop_closure": "Loop closures"}
LONGEST = 400  # lines of code that a page shows


def path_of(component: Component) -> str:
    """Of its page."""
    kind, name = component.kind, component.name
    return f"studies/{name}.md" if kind == "study" else f"{FOLDERS[kind]}/{kind}_{name}.md"


def title_of_kind(kind: str) -> str:
    """As a heading."""
    return TITLES.get(kind, KINDS[kind].plural.replace("_", " ").capitalize())


def component_pages(registry: Registry, recipes: list[Recipe], sources: Sources) -> Iterator[tuple[str, str]]:
    """Path and text of the page of every component."""
    for component in registry.components.values():
        yield path_of(component), page(component, recipes, sources)


def page(component: Component, recipes: list[Recipe], sources: Sources) -> str:
    """The page of one."""
    kind, name, cls = component.kind, component.name, component.cls
    parts = [f"# {name}\n", f"{KINDS[kind].summary}\n{{ .kind }}\n", manual(cls.__doc__) + "\n"]
    if picture := sources.picture(kind, name):
        parts.append(f"![{component.summary}](../{picture})\n")
    parts += [*_camera_model(component), "## Settings\n", settings_of(cls), *_use(component, recipes)]  # type: ignore[arg-type]  # a class is hashable
    if kind == "study" and (figures := sources.figures(name)):
        named = [f"![{Path(figure).stem.partition('-')[2].replace('_', ' ')}](../{figure})" for figure in figures]
        parts += ["## Figures\n", "Of a small run ([gallery](../gallery.md)):\n", "\n\n".join(named) + "\n"]
    if pages := sources.that_name(rf"`{name}`"):
        parts += ["## Read on\n", "\n".join(f"- {link}" for link in pages) + "\n"]
    return "\n".join([*parts, *_code(component)])


def _camera_model(component: Component) -> list[str]:
    """The model that a camera says it has, by the type of its property `camera`."""
    camera = getattr(component.cls, "camera", None)
    model = get_type_hints(camera.fget).get("return") if isinstance(camera, property) else None
    if not isinstance(model, type):
        return []
    return [f"## Camera model\n\n[`{model.__name__}`](../reference/cameras.md):\n", manual(model.__doc__) + "\n"]


def _use(component: Component, recipes: list[Recipe]) -> list[str]:
    kind, name = component.kind, component.name
    using = [recipe for recipe in recipes if (kind, name) in recipe.components]
    command = f"omnilab experiment={using[0].name}\n" if using else ""
    parts = ["## Use\n", f"```\n{command}omnilab plugins {name}\n```\n"]
    if using:
        links = ", ".join(f"[`{recipe.name}`](../recipes/{recipe.name}.md)" for recipe in using)
        parts.append(f"Recipes with it: {links}.\n")
    named = f"from {_home(component)} import {component.cls.__qualname__}"
    return [*parts, f"From Python: `{named}`, of the distribution {component.plugin.distribution}.\n"]


def _home(component: Component) -> str:
    """Where a class is imported from: its plugin, if that has it."""
    top = component.cls.__module__.partition(".")[0]
    return top if hasattr(sys.modules[top], component.cls.__qualname__) else component.cls.__module__


def _code(component: Component) -> list[str]:
    """The file of the method, folded."""
    file = Path(inspect.getsourcefile(component.cls) or "")
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    if not 0 < len(lines) <= LONGEST:
        return []
    module = component.cls.__module__
    return [
        f'??? note "Its code: {module}"\n',
        "    ```python",
        *(f"    {line}".rstrip() for line in lines),
        "    ```\n",
    ]


def kinds_index(registry: Registry, folder: str, title: str, words: str) -> str:
    """The page that lists the components of a folder, kind by kind."""
    parts = [f"# {title}\n", words]
    for kind in (kind for kind in KINDS if FOLDERS[kind] == folder):
        found = [registry.get(kind, name) for name in registry.names(kind)]
        links = [[f"[`{each.name}`]({Path(path_of(each)).name})", manual(each.summary)] for each in found]
        parts += [f"## {title_of_kind(kind)}\n", f"{KINDS[kind].summary}\n", table([kind, "what it is"], links)]
    return "\n".join(parts)
