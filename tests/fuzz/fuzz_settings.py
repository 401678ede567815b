"""Settings of every component: values of any sort, constructed by the builder."""

from __future__ import annotations

import copy
import math
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from random import Random
from types import UnionType
from typing import Any

from fuzz_engine import confirm
from hydra import compose, initialize_config_module
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from omnilab.api.settings import Range, ranges_of
from omnilab.errors import ConfigError
from omnilab.runner.build import build
from omnilab.runner.overrides.recipe_loader import use_recipe_loader
from omnilab.runner.registry import DICTS, Registry, discover

BOX = Path(__file__).parents[1] / "box_world.yaml"
QUICK = (
    "experiment=quickstart", f"sensor.world={BOX}", "sensor.size=32", "sensor.samples=1", "descriptor=tiny_image",
)  # fmt: skip
Taken = Callable[[Any, Range, Random], bool]  # whether to take a random number
FLOATS = [
    math.nan,
    math.inf,
    -math.inf,
    -1.0,
    0.0,
    -0.0,
    1e-320,
    1e-12,
    1e-6,
    0.1,
    0.5,
    1.0,
    2.0,
    90.0,
    1e6,
    1e12,
    1e13,
    1e308,
]
INTS = [-1, 0, 1, 2, 3, 7, 16, 64, 255, 2**31 - 1, 2**31, 2**63, 10**30]
TEXTS = ["", "x", "???", "../x", "a b", "Größe", "${seed}", "null", "room", "\x00", "\x1b[1m", "x" * 5000, "[", "nan"]
OTHERS = [None, "text", [1], {}, {"a": math.nan}, [[]], True, 1.5, [math.inf, 1.0], [0.5, 0.5], [2, 2]]


def values_of(hint: Any, allowed: Range, rng: Random, most: float = math.inf, value: Taken = lambda *_: True) -> Any:
    """A value for a setting of a type: mostly of that type, often at the edge of its range.

    Counts are at most `most`; of random numbers one is drawn anew that is not taken.
    """
    if rng.random() < (0.06 if most == math.inf else 0.02):
        return rng.choice(OTHERS)
    if is_dataclass(hint):
        return random_settings(typing.cast("type[Any]", hint), rng, most, value)
    parts = typing.get_args(hint)
    if typing.get_origin(hint) in {UnionType, typing.Union}:
        return values_of(rng.choice(parts), allowed, rng, most, value)
    if typing.get_origin(hint) is list:
        return [
            values_of(parts[0], allowed, rng, most, value) for _ in range(allowed.count or rng.choice([0, 1, 2, 3]))
        ]
    if typing.get_origin(hint) is dict:
        return {
            rng.choice(["a", "b", "dark"]): values_of(parts[1], allowed, rng, most, value)
            for _ in range(rng.choice([0, 1, 2]))
        }
    if hint is bool:
        return rng.choice([True, False])
    if hint in {int, float}:
        drawn = (_number(hint, allowed, rng, most) for _ in range(100))
        return next((number for number in drawn if value(number, allowed, rng)), 1)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return rng.choice([*(member.name for member in hint), "wrong"])
    return rng.choice(TEXTS) if hint is str else rng.choice(OTHERS)


def _number(hint: Any, allowed: Range, rng: Random, most: float) -> Any:
    if hint is int:
        edges = [int(edge) + by for edge in allowed.limits if math.isfinite(edge) for by in (-1, 0, 1)]
        return rng.choice([n for n in [*INTS, *edges] if n <= most])
    near = [x for x in (allowed.above, allowed.below, *allowed.limits) if x is not None and math.isfinite(x)]
    above = [math.nextafter(x, math.inf) for x in near]
    return rng.choice([*FLOATS, *near, *above, rng.uniform(0, 3), rng.gauss(0, 100)])


def random_settings(
    cls: type[Any], rng: Random, most: float = math.inf, value: Taken = lambda *_: True
) -> dict[str, Any]:
    """Values for one to three settings of a dataclass."""
    hints, ranges = typing.get_type_hints(cls), ranges_of(cls)
    names = [each.name for each in fields(cls)]
    chosen = rng.sample(names, min(len(names), rng.choice([1, 1, 1, 2, 3])))
    return {name: values_of(hints[name], ranges[name], rng, most, value) for name in chosen}


def node_of(cls: type[Any], values: Mapping[str, Any], defaults: Mapping[str, Any] | None = None) -> DictConfig:
    """A component's settings; ConfigError where OmegaConf refuses a value, as the command line says it."""
    node = OmegaConf.structured(cls)
    try:
        for name, value in {**(defaults or {}), **values}.items():
            OmegaConf.update(node, name, value, merge=isinstance(value, dict) and not isinstance(node.get(name), str))
    except OmegaConfBaseException as error:
        raise ConfigError(str(error).splitlines()[0]) from error
    return typing.cast("DictConfig", node)


def composed(overrides: Sequence[str]) -> DictConfig:
    """The configuration of a run, without sinks and cache."""
    GlobalHydra.instance().clear()
    with initialize_config_module("omnilab.conf", version_base="1.3"):
        config = compose("config", [*overrides, "cache=null"])
    for name in list(config.sinks):
        config.sinks[name] = None
    return config


def registered() -> Registry:
    registry = discover("")
    confirm(not registry.failures, "a plugin failed")
    use_recipe_loader(registry)
    return registry


class Constructed:
    """Family: any component of any kind with any values, up to the live component."""

    def __init__(self, _: Path | None = None) -> None:
        self._registry = registered()
        self._base = composed(QUICK)
        self._components = list(self._registry.components.values())

    def __call__(self, seed: str) -> None:
        rng = Random(seed)
        component = rng.choice(self._components)
        node = node_of(component.cls, random_settings(component.cls, rng))
        plural = next((plural for plural, kind in DICTS.items() if kind == component.kind), "")
        config = copy.deepcopy(self._base)
        put(config, component.kind if component.kind in config else plural, node)
        for name, value in random_settings_of_the_run(rng).items():
            put(config, name, value)
        build(config, self._registry)


def random_settings_of_the_run(rng: Random) -> dict[str, Any]:
    """Now and then, a value for seed, threads or cache_gb of its type."""
    if rng.random() > 0.1:
        return {}
    return rng.choice([{"seed": rng.choice(INTS)}, {"threads": rng.choice(INTS)}, {"cache_gb": rng.choice(FLOATS)}])


def put(config: DictConfig, name: str, value: Any) -> None:
    """Set a slot, or what a dictionary of components holds; ConfigError where OmegaConf refuses it."""
    try:
        config[name] = {"fuzzed": value} if name in DICTS else value
    except OmegaConfBaseException as error:
        raise ConfigError(str(error).splitlines()[0]) from error
