"""Variants of a world file: the same world with another light, and objects removed, changed or added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from omnilab.errors import ConfigError, did_you_mean
from omnilab_mirror.scene.world_yaml import Section, suggestion

ADDED = 1_000_000  # numbers of objects that a variant adds, so that all others keep theirs


@dataclass(frozen=True)
class Content:
    """Contents of a variant: objects with their numbers, lamps, and sections with the keys `light` and `sky`."""

    objects: list[tuple[int, Section]]
    lamps: list[Section]
    light: Section | None
    sky: Section | None


def content(s: Section, variant: str | None) -> Content:
    """The world as the file has it, or as one of its `variants` changes it; ConfigError if there is no such variant."""
    variants = s.named("variants")
    objects = list(enumerate(s.sections("objects", "object")))
    light = s.section("light") if "light" in s else None
    sky = s if "sky" in s else None
    s.value("sky", None)
    if variant is None:
        return Content(objects, _lamps(light), light, sky)
    if variant not in variants:
        known = ", ".join(variants) or "none"
        raise ConfigError(f"variant='{variant}' is not in {s.file}; there is {known}{did_you_mean(variant, variants)}")
    v = variants[variant]
    if "light" in v:
        light = light.changed(v.section("light")) if light else v.section("light")
    sky = v if "sky" in v else sky
    v.value("sky", None)
    removed, changes = v.words("remove"), v.named("change")
    named = [entry for _, entry in objects] + _lamps(light)
    _check_names(v, [*removed, *changes], [_name(entry) for entry in named])
    objects = [(number, _changed(entry, changes)) for number, entry in objects if _name(entry) not in removed]
    objects += [(ADDED + i, entry) for i, entry in enumerate(v.sections("add", "added object"))]
    lamps = [_changed(lamp, changes) for lamp in _lamps(light) if _name(lamp) not in removed]
    v.done()
    return Content(objects, lamps, light, sky)


def _lamps(light: Section | None) -> list[Section]:
    return light.sections("lamps", "lamp") if light else []


def _name(s: Section) -> str:
    return s.word("name", str(s.value("kind", "lamp")))


def _changed(s: Section, changes: dict[str, Section]) -> Section:
    return s.changed(changes[_name(s)]) if _name(s) in changes else s


def _check_names(v: Section, wanted: Sequence[str], known: Sequence[str]) -> None:
    for name in wanted:
        if name not in known:
            raise v.wrong(f"names '{name}', but no object or lamp is called so; {suggestion(name, set(known))}")
