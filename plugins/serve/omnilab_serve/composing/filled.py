"""A form as it is filled in, as words of a command: only what differs from the recipe is said."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from omnilab.api import KINDS
from omnilab.errors import ConfigError
from omnilab_serve.composing.composer import Composer

CHOOSE, SET, KEEP = "choose:", "set:", "keep:"  # what names of fields begin with: of slots, settings, members
LEFT_OUT = {"experiment", "logs"}  # words of a run that its form has elsewhere
WORD = re.compile(r"\w+")
FEWEST_SHOWN = 4  # settings of a component that are shown without unfolding


@dataclass(frozen=True)
class Filled:
    """What was filled in, by the names of the fields; several values where several boxes are ticked."""

    experiment: str
    fields: Mapping[str, Sequence[str]] = field(default_factory=dict)
    more: Sequence[str] = ()  # overrides as they were typed

    def choices(self, composer: Composer) -> list[str]:
        """The words that choose other components than the recipe."""
        recipe = {slot["choice"]: slot["recipe"] for slot in composer.form(self.experiment)["slots"] if slot["choice"]}
        return list(self._choices(recipe))

    def _choices(self, recipe: Mapping[str, str | None]) -> Iterator[str]:
        for name, values in self.fields.items():
            choice = name.removeprefix(CHOOSE)
            if name == choice or choice not in recipe:
                continue
            chosen = [value for value in dict.fromkeys(values) if value]
            if not all(map(WORD.fullmatch, chosen)):
                raise ConfigError(f"{choice}={','.join(chosen)} is no name; choose one that is there")
            if chosen and chosen != [recipe[choice]]:
                yield f"{choice}={','.join(chosen)}"
            elif not chosen and recipe[choice]:
                yield f"~{choice}"

    def form(self, composer: Composer) -> dict[str, Any]:
        """The form with the components that are chosen, the first of each where there are several."""
        return dict(composer.form(self.experiment, [word.partition(",")[0] for word in self.choices(composer)]))

    def words(self, composer: Composer) -> list[str]:
        """The overrides, with the experiment before them."""
        values = dict(settings_of(self.form(composer)))
        left_out = [
            name.removeprefix(KEEP)
            for name, ticked in self.fields.items()
            if name.startswith(KEEP) and "on" not in ticked
        ]
        given = [
            f"{path}={value}"
            for path, declared in values.items()
            if (value := self.value(path, declared)) is not None and not any(path.startswith(f"{m}.") for m in left_out)
        ]
        return [
            f"experiment={self.experiment}",
            *self.choices(composer),
            *(f"~{path}" for path in left_out),
            *given,
            *self.more,
        ]

    def value(self, path: str, declared: Mapping[str, Any]) -> str | None:
        """What a setting was set to; None if it is as it was, or its field is empty."""
        given = [value.strip() for value in self.fields.get(f"{SET}{path}", ())]
        value = given[-1] if declared["type"] == "bool" and given else ",".join(dict.fromkeys(filter(None, given)))
        return value if value not in {"", declared["value"]} else None


def settings_of(form: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Every setting of a form by its path; of those that have settings of their own, these."""
    for declared in [*(each for slot in form["slots"] for each in slot["settings"]), *form["run"]]:
        yield from _nested(declared)


def _nested(declared: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    if "settings" not in declared:
        yield declared["path"], declared
    for each in declared.get("settings", ()):
        yield from _nested(each)


def filled_by(experiment: str, overrides: Sequence[str], composer: Composer) -> Filled:
    """A form filled in by overrides; those that have no field stand in `more`."""
    slots = composer.form(experiment)["slots"]
    choices = {slot["choice"] for slot in slots if slot["choice"]}
    members = {slot["path"] for slot in slots if "." in slot["path"]}
    fields: dict[str, Sequence[str]] = {}
    rest = []
    for word in overrides:
        name, _, value = word.partition("=")
        if name in choices and all(map(WORD.fullmatch, value.split(","))):
            fields[f"{CHOOSE}{name}"] = value.split(",")
        elif word.startswith("~") and word[1:] in choices - {"study"}:
            fields[f"{CHOOSE}{word[1:]}"] = [""]
        elif word.startswith("~") and word[1:] in members:
            fields[f"{KEEP}{word[1:]}"] = ["off"]
        elif name not in LEFT_OUT:
            rest.append(word)
    known = dict(settings_of(Filled(experiment, fields).form(composer)))
    for word in rest:
        name, _, value = word.partition("=")
        if name in known:
            fields[f"{SET}{name}"] = [value]
    return Filled(experiment, fields, [word for word in rest if word.partition("=")[0] not in known])


def laid_out(form: Mapping[str, Any]) -> dict[str, Any]:
    """The slots of a form in the order of a page: those that are filled, dictionaries of components, those that are empty."""
    groups: dict[str, list[Any]] = {kind.plural: [] for kind in KINDS.values()}
    for slot in form["slots"]:
        if "." in slot["path"]:
            groups[slot["path"].partition(".")[0]].append(slot)
    single = [slot for slot in form["slots"] if "." not in slot["path"]]
    return {
        "filled": [slot for slot in single if slot["name"]],
        "groups": {plural: members for plural, members in groups.items() if members},
        "empty": [slot for slot in single if not slot["name"]],
    }


def is_main(declared: Mapping[str, Any], position: int) -> bool:
    """Whether a setting is shown without unfolding: it must be given, the recipe sets it, or it is one of the first."""
    return bool(declared["required"]) or position < FEWEST_SHOWN or declared["value"] != declared["default"]
