"""One run: the typed root configuration, building it, executing it. Nothing here knows a method."""

from __future__ import annotations

import hashlib
import logging
import resource
import signal
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import numpy as np
from hydra.core.config_store import ConfigStore
from omegaconf import MISSING, DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from omnilab.api import Parts, Report
from omnilab.cache import Cache
from omnilab.errors import ConfigError, DataError, OmnilabError
from omnilab.fingerprint import file_digests
from omnilab.logbook import DONE, FAILED, INTERRUPTED, Logbook, origin
from omnilab.maps import FILE, about_map, load_places, map_file, save_map
from omnilab.record import Recorder
from omnilab.registry import DICTS, KINDS, Registry, members

log = logging.getLogger("omnilab")
OFF = ("off", "false")  # what YAML makes of off


@dataclass
class Run:
    """The whole configuration of one run. A slot holds a component, or null where the study needs none."""

    sensor: Any = None
    descriptor: Any = None
    distance: Any = None  # null: the descriptor's default distance
    localizer: Any = None
    altimeter: Any = None
    odometry: Any = None
    loop_closure: Any = None
    backend: Any = None
    view_filter: Any = None
    study: Any = MISSING
    descriptors: dict[str, Any] = field(default_factory=dict)  # that a study compares
    distances: dict[str, Any] = field(default_factory=dict)  # that a study compares them with
    localizers: dict[str, Any] = field(default_factory=dict)  # that a study compares
    altimeters: dict[str, Any] = field(default_factory=dict)  # that a study compares
    odometries: dict[str, Any] = field(default_factory=dict)  # that join the run's own
    backends: dict[str, Any] = field(default_factory=dict)  # that a study compares
    view_filters: dict[str, Any] = field(default_factory=dict)  # that a study compares
    sensors: dict[str, Any] = field(default_factory=dict)  # that a study uses beside the run's own
    disturbances: dict[str, Any] = field(default_factory=dict)  # of the queries, in the order they apply
    sinks: dict[str, Any] = field(default_factory=dict)
    map: str | None = None  # a map that another run saved, or that run's folder; it brings its descriptor and distance
    seed: int = 0
    threads: int = 1  # of each matrix product: results are only the same bit for bit with the same number
    logs: str = "logs"  # where run folders go
    cache: str | None = "cache"  # folder of descriptions, within `logs` unless absolute; off: describe everything anew
    cache_gb: float = 4.0  # at most; then those go that were used longest ago


ConfigStore.instance().store(name="omnilab_run", node=Run, provider="omnilab")


def build(config: DictConfig, registry: Registry) -> Run:
    """Live components from a composed configuration, each slot checked against its Protocol."""
    _refuse_unknown(config)
    if not OmegaConf.is_missing(config, "map") and config.map is not None:
        _fill_from_map(config, registry)
    try:
        run = OmegaConf.to_object(config)
    except MissingMandatoryValue as error:
        key = str(error.full_key)
        raise ConfigError(f"{key} is not set and has no default; give {key}=VALUE") from error
    except OmegaConfBaseException as error:
        raise ConfigError(f"{error.full_key}: {str(error).splitlines()[0]}") from error
    assert isinstance(run, Run)
    for name in DICTS:  # null leaves a member out, as it does a slot
        setattr(run, name, {key: member for key, member in getattr(run, name).items() if member is not None})
    if run.distance is None and run.descriptor is not None and not isinstance(run.descriptor, dict):
        run.distance = registry.get("distance", run.descriptor.default_distance).cls()
    for path, kind, value in _components(vars(run)):
        _check_slot(path, kind, value, registry)
    if run.threads < 1:
        raise ConfigError(f"threads={run.threads} cannot compute anything; give threads=1 or more")
    if run.seed < 0:
        raise ConfigError(f"seed={run.seed} starts no random numbers; give seed=0 or more")
    if not run.cache_gb > 0:
        raise ConfigError(f"cache_gb={run.cache_gb:g} holds nothing; give a number above 0, or cache=off")
    lacking = [slot for slot in run.study.needs if not _is_filled(getattr(run, slot))]
    if lacking:
        options = "; ".join(_way_to_fill(slot, registry) for slot in lacking)
        raise ConfigError(f"the study needs a {' and a '.join(lacking)}, and none is chosen; give {options}")
    return run


def _fill_from_map(config: DictConfig, registry: Registry) -> None:
    """A map is asked with the descriptor that made it, and unless another is chosen with its distance."""
    path = map_file(Path(str(config.map)))
    about = about_map(path)
    for slot in ("descriptor", "distance"):
        if slot not in about["components"] or slot not in about["config"]:
            raise DataError(f"{path} does not say with which {slot} it was made; make it anew: omnilab experiment=map")
    own = _component("descriptor", "descriptor", about["config"]["descriptor"], about, registry)
    if config.descriptor is not None and (
        OmegaConf.get_type(config.descriptor) is not OmegaConf.get_type(own) or config.descriptor != own
    ):
        raise ConfigError(
            f"{path} was described by {_brief(about, own)}, and the run's descriptor is another or set otherwise; leave"
            " descriptor=... out, or make a map with it"
        )
    used = about["components"]["descriptor"]
    here = registry.components["descriptor", used["name"]].plugin.version
    if used.get("version") != here:
        log.warning("%s was described by version %s of %s, and %s is installed: distances may not mean the same",
                    path, used.get("version"), used.get("distribution"), here)  # fmt: skip
    config.map, config.descriptor = str(path), own
    if config.distance is None:
        config.distance = _component("distance", "distance", about["config"]["distance"], about, registry)


def _brief(about: Mapping[str, Any], settings: DictConfig) -> str:
    """A component with its settings, in a few words."""
    return f"{about['components']['descriptor']['name']} ({', '.join(f'{k!s}={v}' for k, v in settings.items())})"


def _is_filled(value: Any) -> bool:
    return value is not None and value != {}


def _way_to_fill(slot: str, registry: Registry) -> str:
    if slot == "map":
        return "map=FILE, of a run of experiment=map"
    if slot not in DICTS:
        return f"{slot}={'|'.join(registry.names(slot))}"
    kind = DICTS[slot]
    return f"+{kind}@{slot}.NAME={'|'.join(registry.names(kind))}"


def _refuse_unknown(config: DictConfig) -> None:
    """ConfigError if a setting belongs to no field."""
    for path, settings in _structured(config):
        known = {f.name for f in fields(cast("type[Any]", OmegaConf.get_type(settings)))}
        unknown = [str(key) for key in settings if key not in known]
        if unknown:  # Hydra adds whatever follows a +
            raise ConfigError(
                f"'{path}{unknown[0]}' is not a setting, so +{path}{unknown[0]} does nothing; leave it out"
            )


def _structured(config: DictConfig) -> Iterator[tuple[str, DictConfig]]:
    """The run and each of its components, with the path before their settings."""
    yield "", config
    for path, _, value in _components({str(k): config[k] for k in config if not OmegaConf.is_missing(config, k)}):
        if isinstance(value, DictConfig) and is_dataclass(OmegaConf.get_type(value)):
            yield f"{path}.", value


def _components(settings: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Path, kind and content of every slot of a run's settings, and of every member of its dicts of components."""
    for name, value in settings.items():
        if name in KINDS:
            yield name, name, value
        elif name in DICTS:
            for key, member in value.items():
                yield f"{name}.{key}", DICTS[name], member


def _check_slot(path: str, kind: str, value: Any, registry: Registry) -> None:
    if value is None:
        return
    if isinstance(value, dict):
        names = registry.names(kind)
        first = names[0] if names else "NAME"
        way = (
            f"start it with `defaults: [{first}, _self_]`"
            if path == kind
            else f"choose one, as in +{kind}@{path}={first}"
        )
        raise ConfigError(f"{path} is plain YAML without a component; {way} (registered: {', '.join(names)})")
    lacking = [member for member in members(KINDS[kind]) if not hasattr(value, member)]
    if lacking:
        raise ConfigError(f"{path} is a {type(value).__name__}, which lacks {', '.join(lacking)}; choose a {kind}")


def named_components(run: Run, registry: Registry) -> dict[str, dict[str, str]]:
    """For each slot in use: the registered name, class, distribution and version."""
    found: dict[str, dict[str, str]] = {}
    for slot, _, value in _components(vars(run)):
        if value is None:
            continue
        component = registry.of(value)
        found[slot] = {
            "name": component.name if component else "",
            "class": f"{type(value).__module__}.{type(value).__qualname__}",
            "distribution": component.plugin.distribution if component else "",
            "version": component.plugin.version if component else "",
        }
    return found


def resolved_yaml(run: Run) -> str:
    """The configuration as it ran, defaults and all."""
    return OmegaConf.to_yaml(_resolved(run))


def _resolved(run: Run) -> DictConfig:
    return OmegaConf.create({name: _settings(value) for name, value in vars(run).items()})


def _settings(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _settings(member) for name, member in value.items()}
    return OmegaConf.structured(value) if is_dataclass(value) else value


def execute(run: Run, folder: Path, registry: Registry, overrides: Sequence[str] = (), experiment: str = "") -> Report:
    """Run the study, and leave a complete run folder whatever happens."""
    config_yaml = resolved_yaml(run)
    book = Logbook(folder)
    book.open(manifest_of(run, registry, overrides, experiment, config_yaml), config_yaml, Path(run.logs) / "latest")
    recorder = Recorder(run.sinks, folder)
    cache = _cache(run)
    start = time.perf_counter()
    log.info("run of experiment '%s' starts: %s", experiment, " ".join(overrides))
    try:
        with _signals(recorder), recorder, pinned(run.threads):
            for failure in registry.failures:
                log.info("%s", failure.sentence)  # the command line has told the user
            report: Report = run.study.run(_parts(run, registry, cache), recorder, np.random.default_rng(run.seed))
            book.write(report)
            if report.map is not None:
                save_map(folder / FILE, report.map, _about(run, registry))
    except KeyboardInterrupt:
        book.status(INTERRUPTED, sinks_dropped=recorder.dropped)
        raise
    except Exception as error:
        log.error("the run failed: %s", error, exc_info=not isinstance(error, OmnilabError))
        book.status(FAILED, error=f"{type(error).__name__}: {error}", sinks_dropped=recorder.dropped)
        raise
    else:
        book.status(DONE, sinks_dropped=recorder.dropped)
        log.info("done in %.1f s", time.perf_counter() - start)
    finally:
        book.write_costs(_costs(recorder, cache, time.perf_counter() - start))
        book.close()
    return report


def manifest_of(
    run: Run, registry: Registry, overrides: Sequence[str], experiment: str, config_yaml: str
) -> dict[str, Any]:
    """What is needed to know, and to repeat, a run."""
    return {
        "experiment": experiment,
        "overrides": list(overrides),
        "seed": run.seed,
        "config_hash": hashlib.sha256(config_yaml.encode()).hexdigest(),
        "components": named_components(run, registry),
        "files": file_digests("", run),
        "plugins_failed": [failure.sentence for failure in registry.failures],
        **origin(),
    }


def _about(run: Run, registry: Registry) -> dict[str, Any]:
    """What a saved map says of the components that made it."""
    slots = ("descriptor", "distance", "sensor")
    named = named_components(run, registry)
    config = OmegaConf.to_container(_resolved(run), enum_to_str=True)
    assert isinstance(config, dict)
    return {
        "components": {slot: named[slot] for slot in slots if slot in named},
        "config": {slot: config[slot] for slot in slots if slot in named},
        "omnilab": version("omnilab"),
    }


def _cache(run: Run) -> Cache | None:
    """Where descriptions are kept; None if they are not, or the study measures what describing costs."""
    if run.cache is None or run.cache.lower() in OFF or not getattr(run.study, "cached", True):
        return None
    return Cache(Path(run.logs) / run.cache, int(run.cache_gb * 1e9), run.threads)


def _parts(run: Run, registry: Registry, cache: Cache | None) -> Parts:
    own = {name: registry.get("distance", d.default_distance).cls() for name, d in run.descriptors.items()}
    parts = {f.name: getattr(run, f.name) for f in fields(Parts) if hasattr(run, f.name)}
    if cache is not None:
        parts["descriptor"] = run.descriptor and cache.wrap(run.descriptor)
        parts["descriptors"] = {name: cache.wrap(d) for name, d in run.descriptors.items()}
    parts["map"] = run.map and load_places(Path(run.map))
    return Parts(**parts, default_distances=own)


@contextmanager
def pinned(threads: int) -> Iterator[None]:
    """Fix the number of math threads, so that sums are made in the same order alone and in a sweep."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=threads):
        yield


@contextmanager
def _signals(recorder: Recorder) -> Iterator[None]:
    """Ctrl-C and SIGTERM end the run between two records, never within one."""
    try:
        before = {number: signal.signal(number, recorder.interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not in the main thread: whoever runs us there has signals in hand
        yield
        return
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _costs(recorder: Recorder, cache: Cache | None, wall_s: float) -> list[tuple[str, float, str]]:
    rows = [("wall", wall_s, "s")]
    for stage, (seconds, count) in recorder.costs.items():
        rows.append((stage, seconds, "s"))
        if count > 1:
            rows.append((f"{stage}, each", 1e3 * seconds / count, "ms"))
    if cache is not None and cache.found + cache.made > 0:
        rows += [("described", cache.made, "images"), ("taken from the cache", cache.found, "images")]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    rows.append(("peak memory", peak / (2**20 if sys.platform == "darwin" else 2**10), "MiB"))
    return rows


def again(saved: Mapping[str, Any], manifest: Mapping[str, Any], registry: Registry) -> Run:
    """The run that a saved configuration and manifest describe, with the components that are installed now."""
    config = OmegaConf.structured(Run)
    for name in saved.keys() - KINDS.keys() - DICTS.keys():
        config[name] = saved[name]
    for path, kind, settings in _components(saved):
        if settings is not None:
            OmegaConf.update(config, path, _component(path, kind, settings, manifest, registry))
    return build(config, registry)


def _component(
    slot: str, kind: str, settings: Mapping[str, Any], manifest: Mapping[str, Any], registry: Registry
) -> DictConfig:
    used = manifest["components"][slot]
    component = registry.components.get((kind, used["name"]))
    if component is None:
        raise ConfigError(f"{registry.missing(kind, used['name'])}; the run had it from {used['distribution']}")
    cls = component.cls
    try:
        merged = OmegaConf.merge(OmegaConf.structured(cls), settings)
    except OmegaConfBaseException as error:
        reason = str(error).splitlines()[0]
        raise ConfigError(
            f"the run's {slot} no longer fits {cls.__name__} ({reason}); run the experiment anew"
        ) from error
    assert isinstance(merged, DictConfig)
    return merged
