"""Camera models as JSON files, so that pictures can travel with the camera that took them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from omnilab.cameras.base import CylindricalCamera, EquirectangularCamera, RayCamera
from omnilab.cameras.lenses import FisheyeCamera, PinholeCamera, UnifiedCamera
from omnilab.cameras.mirrors import HyperbolicMirror, ParabolicMirror
from omnilab.cameras.noncentral import ConicalMirror, EllipticMirror, SphericalMirror
from omnilab.cameras.ocam import OCamCamera
from omnilab.cameras.stereo import StereoCamera
from omnilab.errors import ConfigError, DataError, did_you_mean

LARGEST_FILE = 2**20  # bytes
MODELS: dict[str, type[Any]] = {
    model.__name__: model
    for model in (
        ConicalMirror,
        CylindricalCamera,
        EllipticMirror,
        EquirectangularCamera,
        FisheyeCamera,
        HyperbolicMirror,
        OCamCamera,
        ParabolicMirror,
        PinholeCamera,
        SphericalMirror,
        StereoCamera,
        UnifiedCamera,
    )
}


def save_camera(camera: RayCamera, path: Path | str) -> None:
    """Write a camera's model and settings; ConfigError for a camera of a model that is not in `MODELS`."""
    name = type(camera).__name__
    if MODELS.get(name) is not type(camera):
        raise ConfigError(f"a {name} cannot be written to {path}; a file can hold one of {', '.join(sorted(MODELS))}")
    settings = asdict(camera)  # type: ignore[call-overload]  # cameras are frozen dataclasses
    Path(path).write_text(json.dumps({"model": name, **settings}, indent=1) + "\n", encoding="utf-8")


def load_camera(path: Path | str) -> RayCamera:
    """The camera in a file that `save_camera` wrote; DataError that names the key that is missing, unknown or wrong."""
    path = Path(path)
    found = _read(path)
    name = found.pop("model", None)
    if name not in MODELS:
        raise DataError(f"{path} has the model {name!r}; give one of {', '.join(sorted(MODELS))}")
    model = MODELS[name]
    known = {field.name: field.type for field in fields(model)}
    for key, value in found.items():
        if key not in known:
            raise DataError(f"{path} has the unknown key '{key}'{did_you_mean(key, known)}; remove it")
        _check(path, key, value, str(known[key]))
    try:
        return model(**{key: _frozen(value) for key, value in found.items()})  # type: ignore[no-any-return]
    except TypeError as error:
        raise DataError(f"{path} lacks a setting of {name} ({error}); add it") from None
    except ConfigError as error:
        raise DataError(f"{path}: {error}") from None


def _read(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise DataError(f"{path} is larger than {LARGEST_FILE >> 20} MiB; that is no camera")
        found = json.loads(path.read_bytes())
    except OSError as error:
        raise DataError(f"{path} cannot be read ({error.strerror}); give a file that describes a camera") from None
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path} is not JSON ({error}); write it with omnilab.cameras.save_camera") from None
    if not isinstance(found, dict):
        raise DataError(f"{path} holds a {type(found).__name__}; a camera is an object with the key 'model'")
    return found


TYPES: dict[str, tuple[type, ...]] = {"int": (int,), "float": (int, float), "bool": (bool,), "str": (str,)}


def _check(path: Path, key: str, value: Any, declared: str) -> None:
    """DataError unless a value is of the type that a field declares: a number, a text, or a list of numbers."""
    name, _, optional = declared.partition(" | ")
    if optional and value is None:
        return
    is_list = name.startswith("tuple")
    kinds = TYPES["float"] if is_list else TYPES[name]
    values: Iterable[Any] = value if is_list and isinstance(value, list) else [value]
    if is_list != isinstance(value, list) or not all(_is(v, kinds) for v in values):
        raise DataError(f"{path} has {key}={value!r}; write a value of type {declared}")


def _is(value: Any, kinds: tuple[type, ...]) -> bool:
    """JSON knows true beside 1, and NaN and Infinity that are no settings."""
    if isinstance(value, bool):
        return bool in kinds
    return isinstance(value, kinds) and not (isinstance(value, float) and not math.isfinite(value))


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
