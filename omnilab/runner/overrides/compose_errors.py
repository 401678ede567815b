"""What Hydra and OmegaConf say of a configuration that cannot be composed, as one sentence of ours."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from omegaconf.errors import OmegaConfBaseException

from omnilab.api import KINDS
from omnilab.errors import did_you_mean, with_article
from omnilab.runner.config import Run
from omnilab.runner.overrides.setting_types import types_of, wanted
from omnilab.runner.registry import DICTS, MANY, Registry

EXTRAS = {  # by the name of a launcher or a sweeper: the extra of omnilab that has it
    "joblib": "joblib", "submitit_local": "submitit", "submitit_slurm": "submitit", "ray": "ray", "optuna": "optuna",
}  # fmt: skip
NO_HEADER = "the recipe's settings would not be those of the run; begin it with the line '# @package _global_'"
GENERAL = "the settings do not fit together; omnilab --cfg job, with experiment=NAME, shows those that there are"


def sentence(error: Exception, registry: Registry, overrides: Sequence[str] = ()) -> str:
    """What was wrong, with a suggestion; nothing in it is a library's own text."""
    text = f"{error}\n{error.__cause__ or ''}"
    cause = error.__cause__ if isinstance(error.__cause__, OmegaConfBaseException) else error
    recipe = f"{found[1]}: " if (found := re.match(r"In '(experiment/[^']+)': \w+ raised while", text)) else ""
    for pattern, say in _SENTENCES:
        if match := re.search(pattern, text):
            return f"{recipe}{say(match, text, registry)}"
    if found := re.match(r"Error merging override (.*)", str(error), re.DOTALL):
        return _wrong_type(found[1], cause, registry)
    key = str(getattr(cause, "full_key", None) or "") or (
        found[1] if (found := re.search(r"full_key: (\S+)", text)) else ""
    )
    if recipe:
        return recipe + (_takes(key, registry) if key else GENERAL)
    if "nterpolation" in text:
        return not_inserted(key or next((word for word in overrides if "${" in word), "a setting"), text)
    return f"{key}: {GENERAL}" if key else GENERAL


def not_inserted(where: str, reason: str) -> str:
    """The sentence about a ${...} that cannot be filled in."""
    if found := re.search(r"Environment variable '([^']*)' not found", reason):
        return f"{where} inserts the environment variable {found[1]}, which is not set; set it"
    if found := re.search(r"Interpolation key '([^']*)' not found", reason):
        known = [field.name for field in fields(Run)]
        why = f"there is no setting {found[1]}{did_you_mean(found[1].partition('.')[0], known)}"
    elif "Recursive" in reason:
        why = "it would insert itself"
    elif found := re.search(r"Unsupported interpolation type (\S+)", reason):
        why = f"nothing is called {found[1]}; oc.env is, as in ${{oc.env:HOME}}"
    else:
        why = "what it names does not fit there"
    return f"{where} cannot be filled in: {why}; ${{NAME}} inserts the setting NAME, \\${{NAME}} is the text itself"


# ------------------------------------------------------------------------------------------------------- names
def _missing_choice(found: re.Match[str], text: str, registry: Registry) -> str:
    listed_group = re.search(r"Available options in '([^']+)'", text)
    group = listed_group[1] if listed_group else found[1].rpartition("/")[0]
    name = found[1].removeprefix(f"{group}/")
    if group.startswith("experiment/") and group.partition("/")[2] in KINDS:
        return _of_recipe(group, name)
    if group in KINDS:
        return registry.missing(group, name)
    if group in {"hydra/launcher", "hydra/sweeper"} and name in EXTRAS:
        extra = EXTRAS[name]
        return (
            f"{group}={name} needs packages that are not installed; pip install 'omnilab[{extra}]', or in a clone:"
            f" uv sync --inexact --extra {extra}"
        )
    listed = text.partition("Available options")[2].partition("Config search path")[0]
    options = [line.strip() for line in listed.splitlines()[1:] if line.strip()]
    there = f"there is {', '.join(options)}" if options else f"leave {group}= out"
    return f"{group} '{name}' does not exist; {there}{did_you_mean(name, options, f'{group}=')}{registry.failed}"


def _missing_key(found: re.Match[str], text: str, registry: Registry) -> str:
    key, owner = found[1], found[2]
    path = found[1] if (found := re.search(r"Could not override '([^']+)'", text)) else key  # type: ignore[assignment]
    if owner == "HydraConf" or path.startswith("hydra."):
        return f"'{path}' is not a setting of Hydra; omnilab --cfg hydra shows those that there are"
    if path == "experiment":
        return NO_HEADER
    classes: list[type[Any]] = [Run, *(component.cls for component in registry.components.values())]
    cls = next((c for c in classes if c.__name__ == owner), Run)
    known = [field.name for field in fields(cls)]
    where = "a run" if cls is Run else owner
    there = f"there is {', '.join(known)}" if known else "it has none"
    return f"'{path}' is not a setting of {where}; {there}{did_you_mean(key, known) or _other_case(key, known)}{registry.failed}"


def _other_case(key: str, known: Sequence[str]) -> str:
    same = [name for name in known if name.lower() == key.lower()]
    return f" (did you mean {same[0]}?)" if same else ""


def _not_in_struct(found: re.Match[str], text: str, registry: Registry) -> str:
    path = over[1] if (over := re.search(r"Could not override '([^']+)'", text)) else found[1]
    slot, *names = path.split(".")
    if slot in DICTS:
        kind, name = DICTS[slot], names[0] if names else found[1]
        add = f"disturbance={name}" if kind in MANY and name in registry.names(kind) else f"+{kind}@{slot}.{name}=NAME"
        return f"there is nothing called '{name}' in {slot}; add it first, with {add}{registry.failed}"
    if slot in KINDS and len(names) > 1:
        held = ".".join([slot, *names[:-1]])
        return (
            f"there is no '{path}'; if {held} takes any names, give +{path}=VALUE, and if no {slot} is chosen, give"
            f" {slot}=NAME first{registry.failed}"
        )
    if slot in KINDS:
        return f"'{path}' is not a setting yet, for no {slot} is chosen; give {slot}={'|'.join(registry.names(slot))}"
    return f"'{path}' is not a setting; {GENERAL}"


def _not_overridable(found: re.Match[str], _: str, registry: Registry) -> str:
    """A choice that is not in the list of defaults: descriptor@descriptors.a=radon."""
    kind, at, place = found[1].partition("@")
    if place.startswith("experiment."):
        return NO_HEADER
    if kind.startswith("experiment/"):
        return _of_recipe(kind, "NAME")
    if kind not in KINDS:
        known = ["experiment", *KINDS]
        return f"'{found[1]}' is no choice; there is {', '.join(known)}{did_you_mean(kind, known)}{registry.failed}"
    if at and place.partition(".")[0] in DICTS:
        return f"there is no {kind} at {place} yet; add it, with +{kind}@{place}=NAME"
    return f"'{found[1]}' is no place for {with_article(kind)}; give {kind}=NAME, or +{kind}@{KINDS[kind].plural}.NAME=NAME"


def _of_recipe(group: str, name: str) -> str:
    kind = group.partition("/")[2]
    return f"the recipe's defaults choose {with_article(kind)} among recipes; write '- override /{kind}: {name}', with the slash"


def _nothing_to_delete(found: re.Match[str], _: str, registry: Registry) -> str:
    name = found[1]
    if types_of(name, registry) and "." in name:
        return f"~{name}: a setting is never left out; without ~{name} it has its default"
    return f"there is no {name} to leave out; leave ~{name} away{registry.failed}"


def _nothing_chosen(found: re.Match[str], *_: object) -> str:
    name, value = (found[1] + "=").split("=")[:2]
    return (
        f"~{found[1]}: {f'{value} is not what is chosen as {name}' if value else f'no {name} is chosen'}; leave it away"
    )


# ------------------------------------------------------------------------------------------------------- values
def _wrong_type(override: str, cause: Exception, registry: Registry) -> str:
    key = override.partition("=")[0]
    if override.startswith("~"):
        return f"{override}: a setting is never left out; without {override} it has its default"
    if "nterpolation" in type(cause).__name__ or "Grammar" in type(cause).__name__:
        return not_inserted(override, "")
    return f"{override} does not fit: {_takes(key, registry, cause)}"


def _takes(key: str, registry: Registry, cause: Exception | None = None) -> str:
    """What a setting takes; by the class that the error speaks of, where it does."""
    name = key.lstrip("+~").partition("[")[0]
    if name in DICTS:
        return f"{name} takes components by name; ~{name}.NAME leaves one out, +{DICTS[name]}@{name}.NAME=NAME adds one"
    cls, types = getattr(cause, "object_type", None), types_of(name, registry)
    if isinstance(cls, type) and is_dataclass(cls):
        owned = [c for c in registry.components.values() if c.cls is cls]
        only = Registry(components={(c.kind, c.name): c for c in owned}) if owned else registry
        types = types_of(name, only) or types
    return f"{name} takes {wanted(types, name)}"


def _several(found: re.Match[str], _: str, registry: Registry) -> str:
    key, _, value = found[1].partition("=")
    types = types_of(key, registry)
    lists = f"; for a list {key}=[{value}]" if "list" in str(types) or key in MANY else ""
    return f"{found[1]} is several values; for a sweep over them give -m{lists}"


_SENTENCES: list[tuple[str, Any]] = [
    (r"ConfigError raised while resolving interpolation: ([^\n]*)", lambda m, *_: m[1]),  # by a resolver of ours
    (r"Could not (?:find|load) '([^']+)'", _missing_choice),
    (r"Key '([^']*)' (?:is )?not in '(\w+)'", _missing_key),
    (r"Key '([^']*)' is not in struct", _not_in_struct),
    (r"Multiple values for (\w+)\.", lambda m, *_: f"{m[1]} is a choice already, so +{m[1]} would be a second; give {m[1]}=NAME without the +"),
    (r"(\S+) appears more than once in the final defaults", lambda m, *_: f"{m[1]} is a choice already, so +{m[1]} would be a second; give {m[1]}=NAME without the +"),
    (r"Could not override '([^']*)'", _not_overridable),
    (r"An item is already at '([^']*)'", lambda m, *_: f"{m[1]} is there already, so +{m[1]} would be a second; give {m[1]}=VALUE without the +"),
    (r"Could not delete from config. '([^']*)' does not exist", _nothing_to_delete),
    (r"Could not delete from config. The value of '([^']*)'", lambda m, *_: f"~{m[1]}=VALUE leaves out what has that value, and {m[1]} has another; give ~{m[1]}"),
    (r"Could not delete '([^']*)'. No match", _nothing_chosen),
    (r"Ambiguous value for argument '(.*?)'\n", _several),
    (r"Sweep parameters '(.*)' requires --multirun", lambda m, *_: f"{m[1]} is a sweep; give -m before it"),
    (r"In ([^\n]*): Override [^\n]* is defined before '([^'@ ]*)", lambda m, *_: f"{m[1]}: its defaults choose {m[2]} behind an override; write '- override /KIND: NAME' for each, with the slash"),
    (r"does not support sweep type", lambda *_: "interval(...) has no single values to run; give choice(...), range(...) or values with commas"),
    (r"You must specify '([^']*)'", lambda m, _, r: f"no {m[1]} is chosen; give {m[1]}={'|'.join(r.names(m[1])) or 'NAME'}"),
    (r"Cannot find primary config '([^']*)'", lambda m, *_: f"--config-name {m[1]}: there is no such configuration; leave it out, and choose a recipe with experiment=NAME"),
    (r"Primary config directory not found", lambda *_: "--config-path names no folder of recipes; leave it out, and give --config-dir DIR for recipes of your own"),
]  # fmt: skip
