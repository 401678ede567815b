"""Whole tiny runs of every study: components exchanged, and settings at the edges of what they may be."""

from __future__ import annotations

import copy
import math
import shutil
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from fuzz_engine import confirm
from fuzz_settings import composed, node_of, put, random_settings, registered
from omegaconf import DictConfig, OmegaConf

from omnilab.api import Parts
from omnilab.api.settings import Range
from omnilab.limits import limited
from omnilab.runner.build import build
from omnilab.runner.recorder import Recorder
from omnilab.runner.registry import DICTS, Registry

BOX = Path(__file__).parents[1] / "box_world.yaml"
MOST = 64  # of a count, where it is run: what is allowed may take hours


@dataclass(frozen=True)
class Base:
    """A tiny run, as overrides; the kinds of components that are exchanged in it; what its dictionaries hold."""

    overrides: tuple[str, ...]
    kinds: tuple[str, ...]
    members: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)


SENSOR = (f"sensor.world={BOX}", "sensor.size=32", "sensor.samples=1")
ONE = {"descriptors": ("tiny_image",), "distances": ("poc",)}
PATH = "stamp_s,x_m,y_m,z_m,yaw_deg\n" + "".join(f"{i},{-1 + 0.25 * i},{0.02 * i},1,{3 * i}\n" for i in range(7))
BASES = {
    "localization": Base((
        "experiment=quickstart", *SENSOR, "descriptor=tiny_image", "study.step_m=1.5", "study.query_count=4", "study.show=1",
    ), ("descriptor", "distance", "localizer", "disturbance", "sensor", "study")),
    "map": Base(("experiment=map", *SENSOR, "descriptor=tiny_image", "study.step_m=1.5", "study.show=1"), ("descriptor", "study")),
    "steps": Base((
        "experiment=steps", *SENSOR, "study.steps_m=[1.0,1.5]", "study.query_count=3", "study.heading_steps=8",
    ), ("descriptors", "distances", "localizer", "study"), ONE),
    "changes": Base(
        ("experiment=changes", *SENSOR, "study.step_m=1.5", "study.query_count=3"), ("descriptors", "distances", "study"), ONE,
        {"study.conditions": {"higher": {"height_m": 1.2}}},
    ),
    "large_map": Base((
        "experiment=large_map", *SENSOR, "study.steps_m=[1.5,1.0]", "study.query_count=3",
    ), ("descriptor", "distance", "localizers", "study")),
    "route_localization": Base((
        "experiment=route_localization", *SENSOR, "study.path=path.csv", "study.every=2", "study.show=1",
    ), ("descriptors", "distances", "localizers", "study"), {**ONE, "localizers": ("route_filter",)}),
    "catchment": Base((
        "experiment=catchment", *SENSOR, "study.step_m=1.0", "study.extent_m=null", "study.references=3", "~distances.pixels",
    ), ("descriptors", "distances", "study"), ONE),
    "altitude": Base((
        "experiment=altitude", *SENSOR, "study.position_count=1", "study.heights_m=[0.5,1.0,0.25]", "study.references_m=[0.75]", "~localizer",
    ), ("altimeters", "disturbance", "study"), {"altimeters": ("radon_compression",), "disturbances": ()}, {"study.levels": {}}),
    "joint": Base((
        "experiment=joint", *SENSOR, "descriptor=tiny_image", "altimeter=floor_and_walls", "study.step_m=1.5", "study.query_count=2", "study.offsets_m=[0.0,0.2]",
    ), ("altimeter", "localizer", "study")),
    "linearity": Base((
        "experiment=linearity", *SENSOR, "study.step_m=0.25", "study.reach_m=1.0", "study.references=2", "study.show=1",
    ), ("descriptors", "distances", "study"), ONE),
    "cost": Base((
        "experiment=cost", *SENSOR, "study.step_m=1.5", "study.query_count=4", "study.repeats=1",
    ), ("descriptors", "distances", "study"), ONE),
    "robustness": Base((
        "experiment=robustness", *SENSOR, "study.side=3", "study.step_m=0.5", "study.query_count=3",
    ), ("descriptors", "disturbance", "localizer", "study"), {**ONE, "disturbances": ("uniform_noise",)}, {"study.levels": {"uniform_noise": {"level": [0.3]}}}),
    "resolution": Base((
        "experiment=resolution", *SENSOR, "descriptor=tiny_image", "study.side=3", "study.step_m=0.5", "study.query_count=3",
        "study.settings=[rows,columns]", "study.sizes=[[8,16],[4,8]]",
    ), ("distances", "localizer", "study"), {"distances": ("poc",)}),
    "local_map": Base((
        "experiment=local_map", *SENSOR, "descriptor=tiny_image", "study.steps_m=[0.75]", "study.neighbours=[4]", "study.query_count=3", "study.starts=2", "study.show=1",
    ), ("descriptors", "localizers", "study"), {**ONE, "localizers": ("smacof",)}),
    "room": Base((
        "experiment=room", *SENSOR, "descriptor=tiny_image", "study.steps_m=[0.5]", "study.side=3", "study.neighbours=[4]", "study.query_count=2", "study.starts=2",
    ), ("distances", "localizers", "disturbance", "study"), {**ONE, "localizers": ("smacof",), "disturbances": ()}),
    "topological_map": Base((
        "experiment=topological_map", *SENSOR, "study.steps_m=[0.75]", "study.nodes=[4,3]", "study.links=[0,3]", "study.show=1",
    ), ("descriptors", "distances", "localizers", "study"), {**ONE, "localizers": ("smacof",)}),
    "trajectory": Base((
        "experiment=square", *SENSOR, "study.path=path.csv", "study.show=2", "odometry=simulated",
    ), ("odometry", "loop_closure", "backend", "study"), {"backends": ()}),
    "view_slam": Base((
        "experiment=view_slam", *SENSOR, "study.path=path.csv", "study.show=2",
    ), ("odometry", "view_filters", "study"), {"view_filters": ("view_ekf",)}),
    "matching": Base((
        "experiment=matching", *SENSOR, "study.distances_m=[0.5]", "study.pairs=2", "study.images=60", "~odometries.tiles",
    ), ("odometries", "study"), {"odometries": ("planar_epipolar",)}),
    "view_density": Base((
        "experiment=view_density", *SENSOR, "study.path=path.csv", "study.seeds=2", "study.similarities=[0.5]", "study.gains=[0.6]",
        "study.references=2", "study.compared=4", "study.show=2", "~odometries.upright",
    ), ("odometry", "odometries", "view_filters", "study"), {"odometries": ("planar_epipolar",), "view_filters": ("view_ekf",)}),
    "rotations": Base((
        "experiment=rotations", f"sensor.world={BOX}", "sensor.width=64", "sensor.height=32", "sensor.samples=1", "study.pairs=2",
        "study.distances_m=[0.5]", "study.step_m=0.5", "study.show=1",
    ), ("descriptors", "distances", "disturbance", "study"), {"descriptors": ("fourier_signature",), "distances": ("circular_correlation",)}),
    "lifelong_map": Base((
        "experiment=lifelong_map", *SENSOR, "descriptor=tiny_image", "study.step_m=1.5", "study.query_count=3", "study.days=[unchanged,higher]",
    ), ("descriptor", "distance", "study"), settings={"study.conditions": {"higher": {"height_m": 1.2}}}),
    "parameter_curves": Base((
        "experiment=parameter_curves", *SENSOR, "study.step_m=1.5", "study.references=2", "study.line_step_m=0.25", "study.reach_m=1.0",
    ), ("study", "sensor"), {"descriptors": ("fourier_signature",), "distances": ("euclidean",)}, {
        "study.parameters": {"k1": {"of": "descriptors.fourier_signature.magnitudes", "values": [1, 4]}},
    }),
    "graph": Base(
        ("experiment=pose_graph", "study.walk.count=12", "study.walk.side=3"), ("backend", "backends", "study"), {"backends": ()},
    ),
    "views": Base((
        "experiment=view_range", "study.ranges_m=[6.0]", "study.scenarios=[open]", "study.seeds=2", "study.views=3", "study.drives.laps=1",
    ), ("view_filters", "study"), {"view_filters": ("view_ekf",)}),
    "view_count": Base((
        "experiment=view_count", "study.counts=[2,4]", "study.seeds=2", "study.drives.laps=1",
    ), ("view_filters", "study"), {"view_filters": ("view_ekf",)}, {"study.fewer_seeds": {}}),
    "pictures": Base(("experiment=figure_3_10", *SENSOR, "study.poses=[[0,0,1,0,0,0]]", "study.cloud_points=20"), ("sensor", "study")),
    "render": Base((
        "experiment=render", *SENSOR, "study.folder=set", "study.step_m=1.5", "study.show=1",
    ), ("sensor", "disturbance", "study")),
}  # fmt: skip


def runs(name: str) -> Callable[[Path], Callable[[str], None]]:
    """Family: whole tiny runs of a base, one component exchanged or set otherwise."""

    def start(_: Path) -> Callable[[str], None]:
        registry, base = registered(), BASES[name]
        Path("path.csv").write_text(PATH)
        tiny = configured(base, registry)

        def use(seed: str, changed: bool = True) -> None:
            config = copy.deepcopy(tiny)
            if changed:
                change(config, base, registry, Random(seed))
            try:
                report_of(config, registry)
            finally:
                shutil.rmtree("set", ignore_errors=True)

        use("warm", changed=False)
        return use

    return start


def configured(base: Base, registry: Registry) -> DictConfig:
    """A base's configuration, without sinks and cache, with what its dictionaries shall hold."""
    config = composed(base.overrides)
    for plural, names in base.members.items():
        config[plural] = {name: OmegaConf.structured(registry.get(DICTS[plural], name).cls) for name in names}
    for path, value in base.settings.items():
        OmegaConf.update(config, path, value, merge=False)
    return config


def change(config: DictConfig, base: Base, registry: Registry, rng: Random) -> None:
    """Another component of one of the base's kinds, or the same, with one to three settings at random."""
    kind = rng.choice(base.kinds)
    slot = "disturbances" if kind == "disturbance" else kind
    of_kind = DICTS.get(slot, slot)
    if kind in {"study", "sensor"}:
        cls, kept = OmegaConf.get_type(config[kind]), OmegaConf.to_container(config[kind])
    else:
        cls = rng.choice([c for c in registry.components.values() if c.kind == of_kind]).cls
        kept = _small(cls)
    own = typing.cast("dict[str, Any]", kept)
    put(config, slot, node_of(cls, random_settings(cls, rng, MOST, value=_mostly_allowed), own))


def report_of(config: DictConfig, registry: Registry) -> None:
    """Build and run; what it reports is numbers, or says why not."""
    run = build(config, registry)
    given = {each.name: getattr(run, each.name) for each in fields(Parts) if hasattr(run, each.name)}
    own = {key: registry.get("distance", d.default_distance).cls() for key, d in run.descriptors.items()}
    with limited(run.limits):
        report = run.study.run(Parts(**given, default_distances=own), Recorder(), np.random.default_rng(run.seed))
    confirm(len(report.metrics) > 0, "no metrics")
    for metric in report.metrics:  # without a value, which metrics.csv leaves empty, there is a reason
        known = math.isfinite(metric.value) or (math.isnan(metric.value) and metric.note)
        confirm(known, f"the metric {metric.name} is {metric.value}, without a reason")
        ends = [] if metric.interval is None else list(metric.interval)
        confirm(not any(map(math.isinf, ends)), f"the interval of {metric.name} is {metric.interval}")
        if metric.name.endswith("_rate") and math.isfinite(metric.value):
            confirm(0 <= metric.value <= 1, f"the rate {metric.name} is {metric.value}")


def _mostly_allowed(value: Any, allowed: Range, rng: Random) -> bool:
    """Whether to take a random number: what its range does not hold ends at once, and is tried by `Constructed`."""
    return isinstance(value, bool) or value in allowed or rng.random() < 0.03


def _small(cls: type[Any]) -> dict[str, Any]:
    """Settings that make a component quick."""
    small = {"offsets": 32, "angles": 36, "features": 30, "rows": 16, "frequencies": 8, "iterations": 50}
    return {name: value for name, value in small.items() if name in {each.name for each in fields(cls)}}
