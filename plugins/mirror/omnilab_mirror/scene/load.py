"""Loading of worlds: YAML files, read into quads, light and paths, and mesh files. They are kept until a file changes."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from omnilab.errors import ConfigError, DataError
from omnilab.file_kinds import content_of, is_file
from omnilab_mirror.scene.file_stamps import Stamp, stamp_of, stamps_of
from omnilab_mirror.scene.light import Illumination, light
from omnilab_mirror.scene.meshes.hints import unit_of_areas
from omnilab_mirror.scene.model import Model
from omnilab_mirror.scene.objects import add_object
from omnilab_mirror.scene.paths import route
from omnilab_mirror.scene.shipped import shipped
from omnilab_mirror.scene.textures.canvas import Paint
from omnilab_mirror.scene.textures.images import MAX_IMAGE_BYTES, images_of
from omnilab_mirror.scene.textures.procedural import paint, sky_of
from omnilab_mirror.scene.variants import content
from omnilab_mirror.scene.world import World
from omnilab_mirror.scene.world_yaml import MAX_BYTES, read, suggestion

MAX_TEXELS = 40_000_000
MESH_FILES = (".obj", ".glb", ".ply", ".gltf", ".stl", ".off", ".dae", ".fbx", ".usd", ".usdz", ".blend", ".3ds")
GREY = Paint(lambda canvas: canvas.filled([128.0, 128.0, 128.0]))  # stands for a texture that cannot be read
T = TypeVar("T")


def load_world(world: str, variant: str | None = None, up: str | None = None, scale: float = 1.0) -> World:
    """A world that is shipped, by name, or the one in a YAML or mesh file; as it is, or in one of its variants.

    `up`, `scale`: of a mesh file, its axis that points up ("y" or "z"; None: its format's) and metres a unit of it.
    It is kept until one of its files changes.
    """
    file = file_of(world)
    kept = _kept(file, variant, up, scale)
    if kept.sources != stamps_of(kept.sources):
        _load.cache_clear()
        _mesh.cache_clear()
        kept = _kept(file, variant, up, scale)
    return kept


def _kept(file: Path, variant: str | None, up: str | None, scale: float) -> World:
    if file.suffix.lower() not in MESH_FILES:
        _check_no_mesh(file, up, scale)
        return _load(file, _bytes(file), variant)
    if variant is not None:
        raise ConfigError(f"variant={variant!r} of {file} does not exist: a mesh file has none; give variant=null")
    return _mesh(file, stamp_of(file), up, scale)


def problems_of(
    world: str, variant: str | None = None, up: str | None = None, scale: float = 1.0
) -> tuple[World | None, list[DataError]]:
    """The world, where it can be built in spite of them, and all that is wrong with its file."""
    problems: list[DataError] = []
    file = file_of(world)
    try:
        if file.suffix.lower() in MESH_FILES:
            return load_world(world, variant, up, scale), problems
        _check_no_mesh(file, up, scale)
        return _build(file, _bytes(file), variant, problems), problems
    except DataError as error:
        return None, [*problems, error]


def _check_no_mesh(file: Path, up: str | None, scale: float) -> None:
    given = f"up={up}" if up is not None else f"scale={scale:g}" if scale != 1 else ""
    if given:
        raise ConfigError(
            f"{given} is of a mesh file that is the world, and {file} is a world file; write"
            f" '{given.replace('=', ': ')}' in its entry of kind mesh"
        )


def file_of(world: str) -> Path:
    """The file of a world; ConfigError if there is none."""
    file = shipped().get(world, Path(world))
    if not is_file(file):
        if os.path.lexists(file):
            raise ConfigError(
                f"world={world!r} is a folder, a pipe, a device or a link to nothing; give the path of a YAML or mesh file"
            )
        raise ConfigError(
            f"world={world!r} cannot be read (there is no such file); give the path of a YAML or mesh file or a name: {suggestion(world, shipped())}"
        )
    return file


def _bytes(file: Path) -> bytes:
    try:
        return content_of(file, MAX_BYTES)
    except OSError as error:
        raise ConfigError(f"{file} cannot be read ({error.strerror}); give the path of a YAML or mesh file") from None


@lru_cache(maxsize=2)
def _mesh(file: Path, stamp: Stamp, up: str | None, scale: float) -> World:  # noqa: ARG001  another time, another mesh
    from omnilab_mirror.scene.meshes.mesh_world import world_of_mesh

    return world_of_mesh(file, up, scale)


@lru_cache(maxsize=4)
def _load(file: Path, data: bytes, variant: str | None) -> World:
    problems: list[DataError] = []
    world = _build(file, data, variant, problems)
    if problems:
        raise problems[0]
    return world


def _build(file: Path, data: bytes, variant: str | None, problems: list[DataError]) -> World:
    """The world of a file; what is wrong with a texture, an object or a path goes to `problems`, and it is left out."""
    s = read(file, data)
    textures, paths = s.named("textures"), s.named("paths")
    paints = {name: _try(problems, paint, texture) for name, texture in textures.items()}
    model = Model({name: painted or GREY for name, painted in paints.items()})
    x, y = s.size("map_m", 2)
    seed, density = int(s.number("seed", 0, 0, 1e9)), s.number("texels_per_m", 128, 1, 10_000)
    inside = content(s, variant)
    s.done()
    brightness = _try(problems, light, inside.light, inside.lamps) if inside.light else None
    for number, entry in inside.objects:
        _try(problems, add_object, entry, number, model)
    routes = {name: _try(problems, route, path) for name, path in paths.items()}
    texels = sum(float(np.linalg.norm(np.cross(quad.u, quad.v))) for quad in model.quads) * density**2
    if not problems and (not (model.quads or model.meshes) or texels > MAX_TEXELS):
        advice = unit_of_areas(model.areas) or "set texels_per_m"
        raise DataError(
            f"{file} needs {texels:.0f} texels; a world needs a face, and up to {MAX_TEXELS} texels: {advice}"
        )
    named = images_of(textures.values()) if not problems else []
    pictures = [content_of(path, MAX_IMAGE_BYTES) for path in named]
    meshes = [mesh.digest.encode() for mesh in model.meshes]
    return World(
        _digest([data, repr(variant).encode(), *pictures, *meshes]),
        (x, y),
        model.quads,
        model.solids,
        model.areas,
        brightness or Illumination(1.0, []),
        density,
        seed,
        _try(problems, sky_of, inside.sky, textures) if inside.sky else None,
        {name: found for name, found in routes.items() if found},
        tuple(s.named("variants")),
        [mesh.triangles for mesh in model.meshes],
        list(dict.fromkeys(mesh.content for mesh in model.meshes)),
        list(dict.fromkeys(note for mesh in model.meshes for note in mesh.notes)),
        stamps_of(named) | {path: stamp for mesh in model.meshes for path, stamp in mesh.sources.items()},
    )


def _try(problems: list[DataError], make: Callable[..., T], *parts: Any) -> T | None:
    try:
        return make(*parts)
    except DataError as error:
        problems.append(error)
        return None


def _digest(parts: list[bytes]) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()
