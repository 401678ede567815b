"""Values spoilt in every way, and what of that does no harm."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from omnilab.errors import PluginError

# What does no harm, by kind and path or by the path's last word.
OTHER_SIZE = {"one more axis", "fewer columns", "more columns"}
ROWS = {"fewer rows", "more rows", "no rows"}
STATE = {*OTHER_SIZE, *ROWS, "no columns", "a text", "a list", "complex", "texts", "of twice the bytes", "no axis",
         "swapped bytes", "a matrix", "whole numbers"}  # fmt: skip
ALLOWED: dict[str, set[str]] = {
    "sensor.scene": {"None"},
    "sensor.scene.triangles": ROWS,
    "descriptor.describe.place": OTHER_SIZE,  # a first batch says of which shape they are
    "descriptor.describe.heading": {*OTHER_SIZE, "None"},
    "descriptor.state['basis']": STATE,
    "localizer.embed.steps": {*ROWS, "None"},
    "altimeter.relative.value": {"nan", "whole numbers"},  # no estimate
    "altimeter.relative.confidence": {"whole numbers"},
    "altimeter.relative.rotation_rad": {"whole numbers"},
    "altimeter.relative.curves['distance']": {"nan", "inf", "-inf", "whole numbers", *OTHER_SIZE, "no columns"} - {"one more axis"},
    "odometry.extract[0]": {"None", "an object", "a generator", "a text", "NaN alone"},  # its own business
    "odometry.extract[0].vectors": {"fewer columns", "more columns"},
    "sensor.frames.stamps_ns": {"-1", "1 << 40"},
    "localizer.embed.iterations": {"1 << 40"},
    "localizer.locate.heading_rad": {"nan", "None"},  # not known
    "sensor.frames.depth_m": {"nan", "inf", "None"},
    **{path: {"None"} for path in ("sensor.plan.T_world_camera", "sensor.frames.T_world_camera", "distance.match.rotation_rad", "distance.match.R_place_query", "localizer.locate.field",
         "localizer.track.field", "localizer.track.heading_rad", "odometry.extract[0].directions", "odometry.estimate.matches",
         "odometry.estimate.agree", "odometry.estimate.window_rad", "backend.optimize.covariances", "backend.optimize.trusted",
    )},
    "odometry.estimate.failed": {"a text"},
    "odometry.estimate.unit": {"a text"},
    "altimeter.relative.unit": {"a text"},
    "run.metrics[0].value": {"NaN alone"},
    "run.metrics[0].interval": {"None"},
    "run.metrics[0].interval[0]": {"NaN alone"},
    "run.metrics[0].interval[1]": {"NaN alone"},
    "run.tables['queries']['x_m'][0]": {"None", "a text", "NaN alone"},
    "run.tables['queries']['key']": {"a list", "of Python's numbers", "texts", "swapped bytes"},
    "run.map": {"None"},
    "run.map.signatures.place": OTHER_SIZE,
    "run.map.signatures.heading": {*OTHER_SIZE, "None"},
    "run.map.T_world_camera": {"None"},
    "run.map.descriptor_state['basis']": STATE,
    "run.map.provenance": {"None"},
    "run.map.provenance.elevations_deg": {"None"},
    "run.map.provenance.world": {"None", "a text"},
    "run.map.provenance.world_digest": {"None", "a text"},
}  # fmt: skip


def parts(value: Any, path: str = "") -> Iterator[tuple[str, Any, Callable[[Any, Any], Any]]]:
    """Everything in a value: its path, the part, and a function that makes the value anew with another in its place."""
    yield path, value, lambda _, new: new
    for step, part, put in _inner(value):
        for name, found, change in parts(part, f"{path}{step}"):
            yield name, found, lambda whole, new, put=put, part=part, change=change: put(whole, change(part, new))


def _inner(value: Any) -> Iterator[tuple[str, Any, Callable[[Any, Any], Any]]]:
    """What is next within a value."""
    if is_dataclass(value) and type(value).__module__.startswith("omnilab.api"):
        for f in fields(value):
            yield f".{f.name}", getattr(value, f.name), lambda whole, new, n=f.name: _with(whole, n, new)
    if isinstance(value, list | tuple):
        for i in range(min(len(value), 1 if isinstance(value, list) else 9)):
            yield f"[{i}]", value[i], lambda whole, new, i=i: type(whole)([*whole[:i], new, *whole[i + 1 :]])
    if isinstance(value, dict):
        for key in value:
            yield f"[{key!r}]", value[key], lambda whole, new, key=key: whole | {key: new}


def _with(whole: Any, name: str, new: Any) -> Any:
    changed = copy.copy(whole)
    object.__setattr__(changed, name, new)
    return changed


def spoilt(part: Any) -> Iterator[tuple[str, Any]]:
    """A part, spoilt in every way."""
    yield "None", None
    yield "an object", object()
    yield "a generator", (x for x in ())
    yield "a text", "text"
    yield "NaN alone", np.nan
    if not isinstance(part, np.ndarray):
        return
    yield "a list", part.tolist()
    yield "masked", np.ma.masked_array(part, np.ones(part.shape, bool))
    yield "of Python's numbers", part.astype(object)
    if part.dtype.kind != "U":
        yield "complex", part.astype(complex)
        yield "of twice the bytes", part.astype(np.longdouble)
    yield "texts", part.astype(str)
    yield "no axis", part[(0,) * part.ndim]
    yield "one more axis", part[..., None]
    if part.dtype.itemsize > 1:
        yield "swapped bytes", part.astype(part.dtype.newbyteorder())
    for name, values in (
        ("fewer rows", part[:-1]),
        ("more rows", np.concatenate([part, part[:1]])),
        ("no rows", part[:0]),
    ):
        yield name, values
    if part.ndim > 1:
        yield "fewer columns", part[..., :-1]
        yield "more columns", np.concatenate([part, part[..., :1]], axis=-1)
        yield "no columns", part[..., :0]
        if part.T.shape != part.shape:
            yield "transposed", np.ascontiguousarray(part.T)
    if part.ndim == 2:
        yield "a matrix", part.view(np.matrix)
    if part.dtype.kind == "f":
        yield "whole numbers", part.astype(int)
        for name, value in (("nan", np.nan), ("inf", np.inf), ("-inf", -np.inf)):
            changed = part.copy()
            changed[(-1,) * part.ndim] = value
            yield name, changed
    elif part.dtype.kind in "ib":
        yield "floats", part.astype(float)
    if part.dtype == np.int64:
        for name, value in (("-1", -1), ("1 << 40", 1 << 40)):
            changed = part.copy()
            changed.reshape(-1)[-1] = value
            yield name, changed


def harmless(part: np.ndarray) -> Iterator[np.ndarray]:
    """The same numbers, laid out or held otherwise."""
    yield np.asfortranarray(part)
    yield np.repeat(part, 2, axis=-1)[..., ::2]
    yield np.flip(np.flip(part, 0).copy(), 0)
    fixed = part.copy()
    fixed.flags.writeable = False
    yield fixed
    yield np.frombuffer(part.tobytes(), part.dtype).reshape(part.shape)


def is_allowed(path: str, way: str, part: Any) -> bool:
    """Whether it does no harm: a text in place of another, and what the table says."""
    return (way == "a text" and isinstance(part, str)) or way in ALLOWED.get(path, set())


def each_is_a_sentence(path: str, part: Any, attack: Callable[[Any], None], start: str) -> None:
    """However the part is spoilt, one sentence comes of it, or no harm."""
    for way, new in spoilt(part):
        if is_allowed(path, way, part):
            attack(new)
            continue
        try:
            attack(new)
        except PluginError as error:
            sentence = str(error)
        else:
            sentence = "nobody minds"
        assert sentence.startswith(start), f"{path}, {way}: {sentence}"
        assert "\n" not in sentence, way
