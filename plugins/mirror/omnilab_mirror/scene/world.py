"""Virtual worlds: YAML files, read into faces with pictures that hold texture and light, and mesh files."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
import numpy as np

from omnilab.api import Bytes, Floats
from omnilab.errors import ConfigError, DataError
from omnilab_mirror.render.atlas import Atlas, build_atlas
from omnilab_mirror.scene.light import Light, light
from omnilab_mirror.scene.meshes.triangles import Triangles, halves, joined
from omnilab_mirror.scene.objects import add_object
from omnilab_mirror.scene.paths import Route, route
from omnilab_mirror.scene.quads import Area, Face, Model, Solid
from omnilab_mirror.scene.textures.canvas import Canvas, Paint
from omnilab_mirror.scene.textures.images import images_of
from omnilab_mirror.scene.textures.procedural import paint, sky_of
from omnilab_mirror.scene.variants import content
from omnilab_mirror.scene.world_yaml import read, suggestion

if TYPE_CHECKING:
    from omnilab_mirror.render.embree import Embree

CLEARANCE_M = 0.05
MAX_TEXELS = 40_000_000
LATTICE_TEXELS = 5  # light is computed on a lattice this wide, and interpolated
MESH_FILES = (".obj", ".glb", ".ply", ".gltf", ".stl", ".off", ".dae", ".fbx", ".usd", ".usdz", ".blend", ".3ds")
GREY = Paint(lambda canvas: canvas.filled([128.0, 128.0, 128.0]))  # stands for a texture that cannot be read
T = TypeVar("T")


@dataclass(frozen=True)
class World:
    """Faces with their pictures, and where a camera may be."""

    digest: str  # of the file's content, the variant, and the pictures it names
    map_m: tuple[float, float]  # x and y around the origin
    faces: list[Face]
    solids: list[Solid]
    areas: list[Area]
    light: Light
    texels_per_m: float
    seed: int
    sky: Bytes | None = (
        None  # (h, w, 3): what is seen past all faces, row 0 overhead, column 0 to +x, counter-clockwise
    )
    paths: dict[str, Route] = field(default_factory=dict)
    variants: tuple[str, ...] = ()
    meshes: list[Triangles] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # what is wrong with the mesh files and was mended
    sources: dict[Path, tuple[int, int]] = field(default_factory=dict)  # the other files it is made of, `stamp_of` each

    def obstacles(self, points: Floats, on_floor: bool = False) -> list[str]:
        """What each viewpoint (N, 3) is in the way of: "inside 'table'", "outside the room", or "" where it is free.

        `on_floor`: a robot on the floor carries the camera, so what is below the viewpoint is in its way too.
        """
        found = np.full(len(points), "", object)
        for solid in self.solids:
            if on_floor:
                found[solid.is_below(points, CLEARANCE_M)] = f"above '{solid.name}'"
            found[solid.holds(points, CLEARANCE_M)] = f"inside '{solid.name}'"
        if self.areas:
            within = np.any([area.holds(points, CLEARANCE_M) for area in self.areas], axis=0)
            found[~within] = "outside " + " and ".join(sorted({f"the {area.name}" for area in self.areas}))
        if self.meshes:
            from omnilab_mirror.scene.free_space import mesh_obstacles

            free = found == ""
            found[free] = mesh_obstacles(self.embree, points[free], on_floor, CLEARANCE_M)
        return list(found)

    @cached_property
    def pictures(self) -> list[Bytes]:
        """The picture (h, w, 3) of each face as lit; row 0 is at its corner and edge u."""
        brightness = self.light.on(self.faces, LATTICE_TEXELS / self.texels_per_m)
        return [self._picture(face, on_it) for face, on_it in zip(self.faces, brightness, strict=True)]

    @cached_property
    def gray(self) -> Atlas:
        """The pictures' luma at all resolutions."""
        return build_atlas([*self.pictures, *self._sky_picture], color=False)

    @cached_property
    def color(self) -> Atlas:
        """The pictures at all resolutions."""
        return build_atlas([*self.pictures, *self._sky_picture], color=True)

    @property
    def _sky_picture(self) -> list[Bytes]:
        """The sky twice, side by side, so that it goes on at its edges; none where there is no sky."""
        return [] if self.sky is None else [np.hstack([self.sky, self.sky])]

    @cached_property
    def embree(self) -> Embree:
        """Meshes and faces as triangles, ready for rays."""
        from omnilab_mirror.render.embree import Embree

        faces = [halves(self.faces, self.pictures)] if self.faces else []
        return Embree(joined([*self.meshes, *faces]), self.light, self.sky)

    def _picture(self, face: Face, brightness: Floats) -> Bytes:
        width, height = float(np.linalg.norm(face.u)), float(np.linalg.norm(face.v))
        shape = (max(2, round(height * self.texels_per_m)), max(2, round(width * self.texels_per_m)))
        canvas = Canvas((width, height), shape, np.random.default_rng([self.seed, *face.seed]))
        picture = face.paint.painter(canvas)
        if not face.paint.glows:
            picture = picture * cv2.resize(brightness, shape[::-1], interpolation=cv2.INTER_LINEAR)[..., None]
        return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8)


def shipped() -> dict[str, Path]:
    """The files of the worlds that come with the plugin, by name."""
    found = (Path(str(file)) for file in (files("omnilab_mirror") / "worlds").iterdir())
    return {file.stem: file for file in sorted(found) if file.suffix == ".yaml"}


def load_world(world: str, variant: str | None = None) -> World:
    """A world that is shipped, by name, or the one in a YAML or mesh file; as it is, or in one of its variants.

    It is kept until one of its files changes.
    """
    file = file_of(world)
    kept = _kept(file, variant)
    if kept.sources != stamps_of(kept.sources):
        _load.cache_clear()
        _mesh.cache_clear()
        kept = _kept(file, variant)
    return kept


def _kept(file: Path, variant: str | None) -> World:
    if file.suffix.lower() not in MESH_FILES:
        return _load(file, _bytes(file), variant)
    if variant is not None:
        raise ConfigError(f"variant={variant!r} of {file} does not exist: a mesh file has none; give variant=null")
    return _mesh(file, stamp_of(file))


def problems_of(world: str, variant: str | None = None) -> tuple[World | None, list[DataError]]:
    """The world, where it can be built in spite of them, and all that is wrong with its file."""
    problems: list[DataError] = []
    file = file_of(world)
    try:
        if file.suffix.lower() in MESH_FILES:
            return load_world(world, variant), problems
        return _build(file, _bytes(file), variant, problems), problems
    except DataError as error:
        return None, [*problems, error]


def file_of(world: str) -> Path:
    """The file of a world; ConfigError if there is none."""
    file = shipped().get(world, Path(world))
    if not file.is_file():
        raise ConfigError(
            f"world={world!r} cannot be read (there is no such file); give the path of a YAML or mesh file or a name: {suggestion(world, shipped())}"
        )
    return file


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise ConfigError(f"{file} cannot be read ({error.strerror}); give the path of a YAML or mesh file") from None


def stamp_of(file: Path) -> tuple[int, int]:
    """When a file was changed, and its size; zeros where there is none."""
    if not file.is_file():
        return 0, 0
    return file.stat().st_mtime_ns, file.stat().st_size


def stamps_of(paths: Iterable[Path]) -> dict[Path, tuple[int, int]]:
    """The stamps of files."""
    return {path: stamp_of(path) for path in paths}


@lru_cache(maxsize=2)
def _mesh(file: Path, stamp: tuple[int, int]) -> World:  # noqa: ARG001  another time is another mesh
    from omnilab_mirror.scene.meshes.mesh_world import world_of_mesh

    return world_of_mesh(file)


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
    texels = sum(float(np.linalg.norm(np.cross(face.u, face.v))) for face in model.faces) * density**2
    if not problems and (not (model.faces or model.meshes) or texels > MAX_TEXELS):
        raise DataError(
            f"{file} needs {texels:.0f} texels; a world needs a face, and up to {MAX_TEXELS} texels: set texels_per_m"
        )
    named = images_of(textures.values()) if not problems else []
    pictures = [path.read_bytes() for path in named]
    meshes = [mesh.digest.encode() for mesh in model.meshes]
    return World(
        _digest([data, repr(variant).encode(), *pictures, *meshes]),
        (x, y),
        model.faces,
        model.solids,
        model.areas,
        brightness or Light(1.0, []),
        density,
        seed,
        _try(problems, sky_of, inside.sky, textures) if inside.sky else None,
        {name: found for name, found in routes.items() if found},
        tuple(s.named("variants")),
        [mesh.triangles for mesh in model.meshes],
        [note for mesh in model.meshes for note in mesh.notes],
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
