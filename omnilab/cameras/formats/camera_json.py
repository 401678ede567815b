"""omnilab's own camera.json: the name of a camera model, and its settings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from omnilab.cameras.base import CylindricalCamera, EquirectangularCamera, RayCamera
from omnilab.cameras.brown_conrady import BrownConradyCamera
from omnilab.cameras.dual_fisheye import DualFisheyeCamera
from omnilab.cameras.kannala_brandt import KannalaBrandtCamera
from omnilab.cameras.lenses import FisheyeCamera, PinholeCamera, UnifiedCamera
from omnilab.cameras.mirrors import HyperbolicMirror, ParabolicMirror
from omnilab.cameras.noncentral import ConicalMirror, EllipticMirror, SphericalMirror
from omnilab.cameras.ocam import OCamCamera
from omnilab.cameras.plausibility import LARGEST, brief
from omnilab.cameras.stereo import StereoCamera
from omnilab.errors import ConfigError, DataError, did_you_mean

MODELS: dict[str, type[Any]] = {
    model.__name__: model
    for model in (
        BrownConradyCamera,
        ConicalMirror,
        CylindricalCamera,
        DualFisheyeCamera,
        EllipticMirror,
        EquirectangularCamera,
        FisheyeCamera,
        HyperbolicMirror,
        KannalaBrandtCamera,
        OCamCamera,
        ParabolicMirror,
        PinholeCamera,
        SphericalMirror,
        StereoCamera,
        UnifiedCamera,
    )
}
TYPES: dict[str, tuple[type, ...]] = {"int": (int,), "float": (int, float), "bool": (bool,), "str": (str,)}


def camera_of(path: Path, found: Mapping[str, Any]) -> RayCamera:
    """The camera that a camera.json describes; DataError that names the key that is missing, unknown or wrong."""
    name = found["model"]
    if not isinstance(name, str) or name not in MODELS:
        raise DataError(f"{path} has the model {brief(name)}; give one of {', '.join(sorted(MODELS))}")
    model = MODELS[name]
    known = {field.name: str(field.type) for field in fields(model)}
    settings = {key: value for key, value in found.items() if key != "model"}
    needed = {f.name for f in fields(model) if f.default is MISSING and f.default_factory is MISSING}
    if lacking := sorted(needed - set(settings)):
        raise DataError(f"{path} lacks {', '.join(lacking)} of a {name}; add what lacks")
    if unknown := [key for key in settings if key not in known]:
        raise DataError(f"{path} has {_unknown(unknown, name, known)}")
    for key, value in settings.items():
        _check(path, key, value, known[key])
    try:
        return model(**{key: _frozen(value) for key, value in settings.items()})  # type: ignore[no-any-return]
    except ConfigError as error:
        raise DataError(f"{path}: {error}") from None
    except ArithmeticError:  # too large or too small to compute with
        numbers = ", ".join(f"{key}={brief(value)}" for key, value in settings.items() if key != "looks")
        raise DataError(
            f"{path} has numbers of which no {name} is made ({numbers}); one of them is far too large or too small"
        ) from None


def _unknown(keys: list[str], name: str, known: Mapping[str, str]) -> str:
    """Which keys a model has not, and what to do about them: another model may have them."""
    others = [other for other, model in MODELS.items() if set(keys) <= {field.name for field in fields(model)}]
    close = did_you_mean(keys[0], known)
    if close or not others:
        return f"the unknown key '{keys[0][:40]}'{close}; remove it"
    return f"{', '.join(keys)}, which a {name} does not have; models that have: {', '.join(others)}"


def _check(path: Path, key: str, value: Any, declared: str) -> None:
    """DataError unless a value is of the type that a field declares: a number, a text, or a list of numbers."""
    name, _, optional = declared.partition(" | ")
    if optional and value is None:
        return
    is_list = name.startswith("tuple")
    kinds = TYPES["float"] if is_list else TYPES[name]
    values: Iterable[Any] = value if is_list and isinstance(value, list) else [value]
    if is_list != isinstance(value, list) or not all(_is(v, kinds) for v in values):
        raise DataError(f"{path} has {key}={brief(value)}; write a value of type {declared}")
    for number in values:
        if isinstance(number, int | float) and abs(number) > LARGEST:
            raise DataError(f"{path} has {key}={brief(number)}; write a number of a camera's size, up to {LARGEST:g}")


def _is(value: Any, kinds: tuple[type, ...]) -> bool:
    """JSON knows true beside 1, and NaN and Infinity that are no settings."""
    if isinstance(value, bool):
        return bool in kinds
    return isinstance(value, kinds) and not (isinstance(value, float) and not math.isfinite(value))


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
