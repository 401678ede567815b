"""Which names a new component may have."""

from __future__ import annotations

import builtins
import importlib.util
import keyword
import re
import sys

from omnilab.errors import ConfigError
from omnilab.hooks import snake_case
from omnilab.runner.authoring.rendering import NewComponent, identifiers
from omnilab.runner.registry import VALUES, Registry

LONGEST = 50  # of a name, which is that of a file, too
OF_HYDRA = VALUES | {"none", "on", "off", "yes", "no"}  # values, where a name is expected


def check_name(component: NewComponent, module: str, registry: Registry) -> None:
    """ConfigError, with what is wrong, unless a component can have its name, and its module that of `module`."""
    kind, name, cls = component.kind, component.name, component.cls
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or len(name) > LONGEST:
        raise ConfigError(
            f"'{name}' is no name of a component; use up to {LONGEST} lower case letters, digits and _, a letter first"
            + _hint(name)
        )
    if keyword.iskeyword(name) or keyword.iskeyword(cls) or name in OF_HYDRA:
        language = "Python" if keyword.iskeyword(name) or keyword.iskeyword(cls) else "Hydra"
        raise ConfigError(f"'{name}' is a word of {language}; give another name, such as {name}_{kind}")
    if found := registry.find(kind, name):
        raise ConfigError(
            f"there is a {found.title} already, and omnilab tells components apart by their names; give another name"
        )
    if kind == "study":  # which comes with a recipe of that name
        check_recipe_name(name, registry)
    if hasattr(builtins, cls) or cls in identifiers(kind):
        raise ConfigError(
            f"the class of '{name}' would be {cls}, which is taken in its module; give another name, such as my_{name}"
        )
    if module in sys.stdlib_module_names or importlib.util.find_spec(module):
        raise ConfigError(
            f"the module of '{name}' would be {module}, and there is one of that name already (Python's own, or one that is"
            f" installed); give another name, such as my_{name}"
        )


def check_recipe_name(name: str, registry: Registry) -> None:
    """ConfigError unless a recipe can be called so."""
    if not re.fullmatch(r"[A-Za-z0-9_][\w-]*", name, re.ASCII) or len(name) > LONGEST or name in OF_HYDRA:
        raise ConfigError(f"'{name}' is no name of a recipe; use up to {LONGEST} letters, digits, _ and -")
    if taken := registry.recipes.get(name):
        raise ConfigError(f"a recipe of {taken.plugin.title} is called '{name}' already; give another name")


def _hint(name: str) -> str:
    """A name that could be meant: that of a class, or one with hyphens."""
    close = re.sub(r"[^a-z0-9]+", "_", snake_case(name)).strip("_")
    return f" (did you mean {close}?)" if re.fullmatch(r"[a-z][a-z0-9_]*", close) and close != name else ""
