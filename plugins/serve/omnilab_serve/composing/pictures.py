"""Small pictures of what virtual cameras see of the worlds that they know, drawn once for each version."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

from omnilab import __version__
from omnilab.api import RandomPoses
from omnilab.errors import DataError
from omnilab.image import encode
from omnilab.runner.registry import Component, Registry

POSE = RandomPoses(count=1, seed=5)  # one that shows much of every world


def worlds_of(cls: type[Any] | None) -> list[str]:
    """The worlds that a sensor's class says it knows; none of one that knows none, or needs a file first."""
    shipped = getattr(cls, "shipped_worlds", None)
    return list(shipped()) if shipped else []


def picture(registry: Registry, name: str, world: str) -> str:
    """The file of a picture, PNG, of one of a sensor's worlds; DataError if there can be none."""
    component = registry.find("sensor", name)
    if component is None or world not in worlds_of(component.cls):
        raise DataError(f"sensor '{name}' knows no world '{world}'")
    file = _file(component, world, registry)
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        new = file.with_suffix(f".{os.getpid()}")
        new.write_bytes(_drawn(component.cls, world))
        new.replace(file)
    return str(file)


def _drawn(cls: type[Any], world: str) -> bytes:
    sensor = cls(world=world, color=True)
    frames = next(iter(sensor.frames(sensor.plan(POSE))))
    return encode(frames.images[0], "png")


def _file(component: Component, world: str, registry: Registry) -> Path:
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    cache = given if given.is_absolute() else Path.home() / ".cache"
    plugin = component.plugin
    shipped = registry.worlds.get(world)  # in a single file, a world changes without a version
    content = (
        __version__, plugin.distribution, plugin.version, component.name, world,
        shipped and hashlib.sha256(shipped.file.read_bytes()).hexdigest(),
    )  # fmt: skip
    return cache / "omnilab" / "pictures" / f"{hashlib.sha256(repr(content).encode()).hexdigest()[:24]}.png"
