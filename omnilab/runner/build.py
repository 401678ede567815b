"""From a composed configuration to live components, every slot checked."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, cast, get_type_hints

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from omnilab.api import KINDS
from omnilab.api.settings import out_of_range
from omnilab.errors import ConfigError, DataError, with_article
from omnilab.runner.boundaries import check_declared
from omnilab.runner.config import Run, Settings, components_of, literal, logs_folder, structured
from omnilab.runner.devices import check_device
from omnilab.runner.input_files import file_digests, leaves, listed, unknown_inputs
from omnilab.runner.map_file import about_map, map_file
from omnilab.runner.overrides.compose_errors import not_inserted, sentence
from omnilab.runner.overrides.setting_types import wanted
from omnilab.runner.registry import DICTS, Registry, members
from omnilab.runner.shards.shard import shard_of
from omnilab.runner.storage.inputs import with_local_inputs
from omnilab.runner.sweeps.objective import check_objective

LONGEST_TEXT = 4096  # characters, as of a path

log = logging.getLogger("omnilab")


def build(config: DictConfig, registry: Registry) -> Run:
    """The run of a composed configuration: live components, each slot checked against its Protocol, none lacking."""
    run = components(config, registry)
    if run.study is None:
        raise ConfigError("study is not set and has no default; give study=NAME")
    logs_folder(run.logs)
    lacking = [slot for slot in run.study.needs if not _is_filled(getattr(run, slot))]
    if lacking:
        options = "; ".join(_way_to_fill(slot, registry) for slot in lacking)
        needed = " and ".join(slot if slot in DICTS else with_article(slot) for slot in lacking)
        raise ConfigError(f"the study needs {needed}, and none is chosen; give {options}")
    check_objective(run.objective, run.study)
    check_device(run.device, registry)
    shard_of(run.shard, run.study)
    return run


def components(config: DictConfig, registry: Registry) -> Run:
    """Live components from a composed configuration, which need not be all that a run has: it may lack a study."""
    if OmegaConf.is_missing(config, "study"):
        config.study = None
    _refuse_unfilled(config)
    _refuse_unknown(config)
    _refuse_nested(config)
    config, urls = with_local_inputs(config)
    if not OmegaConf.is_missing(config, "map") and config.map is not None:
        _fill_from_map(config, registry)
    try:
        for path, settings in structured(config):
            _refuse_out_of_range(settings, path)
        run = OmegaConf.to_object(config)
    except MissingMandatoryValue as error:
        key = str(error.full_key)
        raise ConfigError(f"{key} is not set and has no default; give {key}=VALUE") from error
    except OmegaConfBaseException as error:
        raise ConfigError(sentence(error, registry)) from error
    assert isinstance(run, Run)
    run.urls = urls
    for name, kind in DICTS.items():
        if not isinstance(getattr(run, name), dict):
            raise ConfigError(f"{name} holds components by name; give each one, as in +{kind}@{name}.NAME=...")
    for name in DICTS:  # null leaves a member out, as it does a slot
        setattr(run, name, {key: member for key, member in getattr(run, name).items() if member is not None})
    if run.distance is None and run.descriptor is not None and not isinstance(run.descriptor, dict):
        run.distance = registry.get("distance", run.descriptor.default_distance).cls()
    for path, kind, value in components_of(vars(run)):
        _check_slot(path, kind, value, registry)
    return run


def _fill_from_map(config: DictConfig, registry: Registry) -> None:
    """A map is queried with the descriptor that made it, and unless another is chosen with its distance."""
    path = map_file(Path(str(config.map)))
    about = about_map(path)
    for slot in ("descriptor", "distance"):
        if slot not in about["components"] or slot not in about["config"]:
            raise DataError(f"{path} does not say with which {slot} it was made; make it anew: omnilab experiment=map")
    own = _component("descriptor", "descriptor", about["config"]["descriptor"], about, registry)
    if config.descriptor is None:
        _refuse_unknown_inputs(path, "descriptor", own, about)
    elif not _describes_alike(config.descriptor, own, about["files"]):
        raise ConfigError(
            f"{path} was described by {_brief(about, own)}, and the run's descriptor is another or set otherwise; leave"
            " descriptor=... out, or make a map with it"
        )
    used = about["components"]["descriptor"]
    here = registry.get("descriptor", used["name"]).plugin.version
    if used.get("version") != here:
        log.warning("%s was described by version %s of %s, and %s is installed: distances may not mean the same",
                    path, used.get("version"), used.get("distribution"), here)  # fmt: skip
    config.map = literal(str(path))
    if config.descriptor is None:
        config.descriptor = own
    if config.distance is None:
        config.distance = _component("distance", "distance", about["config"]["distance"], about, registry)
        _refuse_unknown_inputs(path, "distance", config.distance, about)


def _refuse_unknown_inputs(path: Path, slot: str, component: DictConfig, about: Mapping[str, Any]) -> None:
    """ConfigError if a map names a file of ours by which it was not made: it may be a stranger's."""
    if unknown := unknown_inputs(slot, component, about["files"]):
        name = about["components"][slot]["name"]
        raise ConfigError(
            f"{path} names {listed(unknown)}, which is not known to be what it was made with, so it is not opened; look at"
            f" it and give it yourself: {slot}={name} {unknown[0]}"
        )


def _describes_alike(given: DictConfig, own: DictConfig, known: Mapping[str, str]) -> bool:
    """Whether a descriptor is the one of a map: of the same settings, and of the same files wherever they lie."""
    if OmegaConf.get_type(given) is not OmegaConf.get_type(own):
        return False
    here, settings = file_digests("descriptor", given), dict(leaves("descriptor", given))
    return all(
        here.get(name) == known[name] if name in known else settings.get(name) == value
        for name, value in leaves("descriptor", own)
    )


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


def _refuse_unfilled(config: DictConfig) -> None:
    """ConfigError if a setting inserts what is not there."""
    for path, settings in structured(config):
        for key in settings:
            try:
                _ = None if OmegaConf.is_missing(settings, key) else settings[key]
            except OmegaConfBaseException as error:
                raw = OmegaConf.to_container(settings, resolve=False, throw_on_missing=False)
                assert isinstance(raw, dict)
                raise ConfigError(not_inserted(f"{path}{key!s}={raw[key]}", str(error))) from error


def _refuse_nested(config: DictConfig) -> None:
    """ConfigError if a list of numbers or texts holds a list, which OmegaConf lets pass."""
    for path, settings in structured(config):
        hints = get_type_hints(cast("type[Any]", OmegaConf.get_type(settings)))
        raw = OmegaConf.to_container(settings, resolve=False, throw_on_missing=False)
        assert isinstance(raw, dict)
        for key, value in raw.items():
            name, hint = f"{path}{key!s}", hints.get(str(key), Any)
            nested = isinstance(value, list) and any(isinstance(member, list) for member in value)
            if nested and not re.search(r"(?i)list\[list|Any", str(hint)):
                raise ConfigError(f"{name}={value} does not fit: {name} takes {wanted([hint], name)}")


def _refuse_unknown(config: DictConfig) -> None:
    """ConfigError if a setting belongs to no field."""
    for path, settings in structured(config):
        known = {f.name for f in fields(cast("type[Any]", OmegaConf.get_type(settings)))}
        unknown = [str(key) for key in settings if key not in known]
        if unknown:  # Hydra adds whatever follows a +
            raise ConfigError(
                f"'{path}{unknown[0]}' is not a setting, so +{path}{unknown[0]} does nothing; leave it out"
            )


def _refuse_out_of_range(settings: DictConfig, path: str) -> None:
    """ConfigError if a number is not what its setting declares, before any component is made of it."""
    cls = cast("type[Any]", OmegaConf.get_type(settings))
    cls = Settings if cls is Run else cls  # its slots are checked one by one
    values: dict[str, Any] = {}
    for name in (f.name for f in fields(cls) if not OmegaConf.is_missing(settings, f.name)):
        value = settings[name]
        if isinstance(value, DictConfig) and is_dataclass(OmegaConf.get_type(value)):
            _refuse_out_of_range(value, f"{path}{name}.")
        else:
            values[name] = OmegaConf.to_container(value) if OmegaConf.is_config(value) else value
    if wrong := out_of_range(cls, values, path):
        raise ConfigError(wrong)
    for name, value in values.items():
        if any("\0" in text for text in _texts(value)):
            raise ConfigError(f"{path}{name} holds the character NUL, which no name and no path has; leave it out")
        if (longest := max(map(len, _texts(value)), default=0)) > LONGEST_TEXT:
            raise ConfigError(f"{path}{name} holds a text of {longest} characters; give up to {LONGEST_TEXT}")


def _texts(value: Any) -> Iterator[str]:
    """Every text in a value, its lists and its dictionaries."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        yield from _texts([*value, *value.values()])
    elif isinstance(value, list):
        for each in value:
            yield from _texts(each)


def _check_slot(path: str, kind: str, value: Any, registry: Registry) -> None:
    if value is None:
        return
    if isinstance(value, dict):
        names = registry.names(kind)
        first = names[0] if names else "NAME"
        remedy = (
            f"start it with `defaults: [{first}, _self_]`"
            if path == kind
            else f"choose one, as in +{kind}@{path}={first}"
        )
        raise ConfigError(f"{path} is plain YAML without a component; {remedy} (registered: {', '.join(names)})")
    lacking = [member for member in members(KINDS[kind].protocol) if not hasattr(value, member)]
    if lacking:
        raise ConfigError(
            f"{path} is a {type(value).__name__}, which lacks {', '.join(lacking)}; choose {with_article(kind)}"
        )
    check_declared(kind, value, registry.title_of(kind, value))


def again(
    saved: Mapping[str, Any],
    manifest: Mapping[str, Any],
    registry: Registry,
    folder: Path | None = None,
    known: Mapping[str, str] | None = None,
) -> Run:
    """The run that a saved configuration and manifest describe, with the components that are installed now.

    Where a `folder` is given, what they write goes below it, whatever their settings say. DataError for files and folders
    that settings name and whose digests are not the `known` ones, where these are given.
    """
    _check_saved(saved, manifest)
    if saved.get("shard") is not None:
        raise DataError(f"the run is shard {saved['shard']} of a sweep; give the sweep's last run, which merged all")
    config = OmegaConf.structured(Run)
    for name in saved.keys() - KINDS.keys() - DICTS.keys():
        try:
            config[name] = literal(saved[name])
        except OmegaConfBaseException as error:
            raise DataError(
                f"the run's config.yaml has {name}={saved[name]}, which does not fit; run it anew"
            ) from error
    for path, kind, settings in components_of(saved):
        if settings is not None:
            component = _component(path, kind, settings, manifest, registry)
            if known is not None and getattr(OmegaConf.get_type(component), "live", False):
                raise DataError(
                    f"the run's {path} was live, as a camera or an address is: it shows other pictures now, and a saved run may"
                    " name any; add --trust to open it nevertheless"
                )
            if folder is not None:
                _write_below(folder, path, component)
            OmegaConf.update(config, path, component)
    if known is not None and (unknown := unknown_inputs("", config, known, [config.logs, str(saved.get("logs"))])):
        raise DataError(
            f"the run names {listed(unknown)}, of which its manifest holds no digest or another: changed since, or never"
            " read; look at each, then add --trust to open them nevertheless"
        )
    return build(config, registry)


def _write_below(folder: Path, path: str, component: DictConfig) -> None:
    """Have a component's files written into a run's folder, whatever a saved configuration says."""
    for each in fields(cast("type[Any]", OmegaConf.get_type(component))):
        if "writes" in each.metadata and not OmegaConf.is_missing(component, each.name) and component[each.name]:
            component[each.name] = literal(str(folder / f"{path}.{each.name}"))


def _check_saved(saved: Mapping[str, Any], manifest: Mapping[str, Any]) -> None:
    """DataError if what a run saved does not say what its components are and how they were set."""
    for name in saved.keys() & DICTS.keys():
        if not isinstance(saved[name], dict):
            raise DataError(
                f"the run's config.yaml has {name}={saved[name]}, and components by name belong there; run it anew"
            )
    named = manifest.get("components")
    for path, _, settings in components_of(saved):
        used = named.get(path) if isinstance(named, dict) else None
        words = isinstance(used, dict) and all(isinstance(used.get(key), str) for key in ("name", "distribution"))
        if settings is not None and not (words and isinstance(settings, dict)):
            raise DataError(f"the run's config.yaml and manifest.json do not say what its {path} was; run it anew")


def _component(
    slot: str, kind: str, settings: Mapping[str, Any], manifest: Mapping[str, Any], registry: Registry
) -> DictConfig:
    used = manifest["components"][slot]
    component = registry.find(kind, used["name"])
    if component is None:
        raise ConfigError(f"{registry.missing(kind, used['name'])}; the run had it from {used.get('distribution')}")
    cls = component.cls
    try:
        merged = OmegaConf.merge(OmegaConf.structured(cls), literal(settings))
    except OmegaConfBaseException as error:
        key = getattr(error, "full_key", None)
        raise ConfigError(
            f"the run's {slot} no longer fits {cls.__name__}{f' (its setting {key})' if key else ''}; run the experiment anew"
        ) from error
    assert isinstance(merged, DictConfig)
    return merged
