"""Settings of every component: values of any sort, constructed by the builder, and tiny runs of them."""

from __future__ import annotations

import copy
import math
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from pathlib import Path
from random import Random
from types import UnionType
from typing import Any

import numpy as np
from fuzz_engine import confirm
from hydra import compose, initialize_config_module
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from omnilab.api import Parts
from omnilab.api.settings import Range, ranges_of
from omnilab.errors import ConfigError
from omnilab.runner.build import build
from omnilab.runner.recorder import Recorder
from omnilab.runner.registry import DICTS, Registry, discover

BOX = Path(__file__).parents[1] / "box_world.yaml"
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
MOST = 64  # of a count, where it is run: what is allowed may take hours


@dataclass(frozen=True)
class Base:
    """A tiny run, as overrides, and the kinds of components that are exchanged in it."""

    overrides: tuple[str, ...]
    kinds: tuple[str, ...]


SENSOR = (f"sensor.world={BOX}", "sensor.size=32", "sensor.samples=1")
PATH = "stamp_s,x_m,y_m,z_m,yaw_deg\n" + "".join(f"{i},{-1 + 0.25 * i},{0.02 * i},1,{3 * i}\n" for i in range(7))
BASES = {
    "localization": Base((
        "experiment=quickstart", *SENSOR, "descriptor=tiny_image", "study.step_m=1.5", "study.query_count=4", "study.show=1",
    ), ("descriptor", "distance", "localizer", "disturbance", "sensor", "study")),
    "altitude": Base((
        "experiment=altitude", *SENSOR, "disturbances={}", "study.levels={}", "altimeters={}", "+altimeter@altimeters.a=radon_compression", "study.position_count=1", "study.heights_m=[0.5,1.0,0.25]", "study.references_m=[0.75]", "~localizer",
    ), ("altimeters", "study")),
    "trajectory": Base((
        "experiment=square", *SENSOR, "study.path=path.csv", "study.show=2", "odometry=simulated", "backends={}",
    ), ("odometry", "loop_closure", "backend", "study")),
    "graph": Base(("experiment=pose_graph", "study.walk.count=12", "study.walk.side=3", "backends={}"), ("backend", "study")),
    "views": Base((
        "experiment=view_range", "study.ranges_m=[6.0]", "study.scenarios=[open]", "study.seeds=2", "study.views=3", "study.drives.laps=1",
    ), ("view_filters", "study")),
}  # fmt: skip


def values_of(hint: Any, allowed: Range, rng: Random, most: float = math.inf) -> Any:
    """A value for a setting of a type: mostly of that type, often at the edge of its range."""
    if rng.random() < 0.06:
        return rng.choice(OTHERS)
    if is_dataclass(hint):
        return random_settings(hint, rng, most)
    parts = typing.get_args(hint)
    if typing.get_origin(hint) in {UnionType, typing.Union}:
        return values_of(rng.choice(parts), allowed, rng, most)
    if typing.get_origin(hint) is list:
        return [values_of(parts[0], allowed, rng, most) for _ in range(allowed.count or rng.choice([0, 1, 2, 3]))]
    if typing.get_origin(hint) is dict:
        return {
            rng.choice(["a", "b", "dark"]): values_of(parts[1], allowed, rng, most)
            for _ in range(rng.choice([0, 1, 2]))
        }
    if hint is bool:
        return rng.choice([True, False])
    edges = [edge + by for edge in allowed.limits if math.isfinite(edge) for by in (-1, 0, 1)]
    if hint is int:
        return rng.choice([n for n in [*INTS, *map(int, edges)] if n <= most])
    if hint is float:
        near = [x for x in (allowed.above, allowed.below, *allowed.limits) if x is not None and math.isfinite(x)]
        return rng.choice(
            [*FLOATS, *near, *(math.nextafter(x, math.inf) for x in near), rng.uniform(0, 3), rng.gauss(0, 100)]
        )
    if isinstance(hint, type) and issubclass(hint, Enum):
        return rng.choice([*(member.name for member in hint), "wrong"])
    return rng.choice(TEXTS) if hint is str else rng.choice(OTHERS)


def random_settings(cls: type[Any], rng: Random, most: float = math.inf) -> dict[str, Any]:
    """Values for one to three settings of a dataclass."""
    hints, ranges = typing.get_type_hints(cls), ranges_of(cls)
    names = [each.name for each in fields(cls)]
    chosen = rng.sample(names, min(len(names), rng.choice([1, 1, 1, 2, 3])))
    return {name: values_of(hints[name], ranges[name], rng, most) for name in chosen}


def node_of(cls: type[Any], values: Mapping[str, Any], defaults: Mapping[str, Any] | None = None) -> DictConfig:
    """A component's settings; ConfigError where OmegaConf refuses a value, as the command line says it."""
    node = OmegaConf.structured(cls)
    try:
        for name, value in {**(defaults or {}), **values}.items():
            OmegaConf.update(node, name, value, merge=isinstance(value, dict) and not isinstance(node.get(name), str))
    except OmegaConfBaseException as error:
        raise ConfigError(str(error).splitlines()[0]) from error
    return typing.cast("DictConfig", node)


def composed(base: Base) -> DictConfig:
    """A base's configuration, without sinks and cache."""
    GlobalHydra.instance().clear()
    with initialize_config_module("omnilab.conf", version_base="1.3"):
        config = compose("config", [*base.overrides, "cache=null"])
    for name in list(config.sinks):
        config.sinks[name] = None
    return config


def registered() -> Registry:
    registry = discover("")
    confirm(not registry.failures, "a plugin failed")
    return registry


class Constructed:
    """Family: any component of any kind with any values, up to the live component."""

    def __init__(self, _: Path | None = None) -> None:
        self._registry = registered()
        self._base = composed(BASES["localization"])
        self._components = list(self._registry.components.values())

    def __call__(self, seed: str) -> None:
        rng = Random(seed)
        component = rng.choice(self._components)
        node = node_of(component.cls, random_settings(component.cls, rng))
        plural = next((plural for plural, kind in DICTS.items() if kind == component.kind), "")
        config = copy.deepcopy(self._base)
        _put(config, component.kind if component.kind in config else plural, node)
        for name, value in random_settings_of_the_run(rng).items():
            _put(config, name, value)
        build(config, self._registry)


def random_settings_of_the_run(rng: Random) -> dict[str, Any]:
    """Now and then, a value for seed, threads or cache_gb of its type."""
    if rng.random() > 0.1:
        return {}
    return rng.choice([{"seed": rng.choice(INTS)}, {"threads": rng.choice(INTS)}, {"cache_gb": rng.choice(FLOATS)}])


def _put(config: DictConfig, name: str, value: Any) -> None:
    try:
        config[name] = {"fuzzed": value} if name in DICTS else value
    except OmegaConfBaseException as error:
        raise ConfigError(str(error).splitlines()[0]) from error


def runs(name: str) -> Callable[[Path], Callable[[str], None]]:
    """Family: whole tiny runs of a base, one component exchanged or set otherwise."""

    def start(_: Path) -> Callable[[str], None]:
        registry, base = registered(), BASES[name]
        Path("path.csv").write_text(PATH)
        tiny = composed(base)
        by_kind = {
            kind: [c for c in registry.components.values() if c.kind == DICTS.get(kind, kind)] for kind in _kinds(base)
        }

        def use(seed: str, changed: bool = True) -> None:
            rng = Random(seed)
            config = copy.deepcopy(tiny)
            if changed:
                kind = rng.choice(list(by_kind))
                same = kind in {"study", "sensor"}
                cls = OmegaConf.get_type(tiny[kind]) if same else rng.choice(by_kind[kind]).cls
                kept = OmegaConf.to_container(tiny[kind]) if same else _small(cls)
                _put(config, kind, node_of(cls, random_settings(cls, rng, MOST), typing.cast("dict[str, Any]", kept)))
            run = build(config, registry)
            given = {each.name: getattr(run, each.name) for each in fields(Parts) if hasattr(run, each.name)}
            own = {key: registry.get("distance", d.default_distance).cls() for key, d in run.descriptors.items()}
            report = run.study.run(Parts(**given, default_distances=own), Recorder(), np.random.default_rng(run.seed))
            for metric in report.metrics:  # without a value, which metrics.csv leaves empty, there is a reason
                known = math.isfinite(metric.value) or (math.isnan(metric.value) and metric.note)
                confirm(known, f"the metric {metric.name} is {metric.value}, without a reason")

        use("warm", changed=False)
        return use

    return start


def _kinds(base: Base) -> list[str]:
    return ["disturbances" if kind == "disturbance" else kind for kind in base.kinds]


def _small(cls: type[Any]) -> dict[str, Any]:
    """Settings that make a component quick."""
    small = {"offsets": 32, "angles": 36, "features": 30, "rows": 16, "frequencies": 8, "iterations": 50}
    return {name: value for name, value in small.items() if name in {each.name for each in fields(cls)}}
