"""Virtual worlds: YAML files, read into faces with pictures that hold texture and light."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np

from omnilab.api import Bytes, Floats
from omnilab.errors import ConfigError, DataError
from omnilab_mirror.atlas import Atlas, build_atlas
from omnilab_mirror.canvas import Canvas
from omnilab_mirror.faces import Face, Model, Solid
from omnilab_mirror.light import Light, light
from omnilab_mirror.objects import add_object
from omnilab_mirror.reader import read, suggestion
from omnilab_mirror.textures import textures

CLEARANCE_M = 0.05
MAX_TEXELS = 40_000_000


@dataclass(frozen=True)
class World:
    """Faces with their pictures, and where a camera may be."""

    digest: str  # of the file's content
    map_m: tuple[float, float]  # x and y around the origin
    faces: list[Face]
    solids: list[Solid]
    room: Floats | None  # (2, 3): lowest and highest corner
    light: Light
    texels_per_m: float
    seed: int
    sky: Bytes | None = (
        None  # (h, w, 3): what is seen past all faces, row 0 overhead, column 0 to +x, counter-clockwise
    )

    def obstacles(self, points: Floats, on_floor: bool = False) -> list[str]:
        """What each viewpoint (N, 3) is in the way of: "inside 'table'", "outside the room", or "" where it is free.

        `on_floor`: a robot on the floor carries the camera, so what is below the viewpoint is in its way too.
        """
        found = np.full(len(points), "", object)
        for solid in self.solids:
            if on_floor:
                found[solid.is_below(points, CLEARANCE_M)] = f"above '{solid.name}'"
            found[solid.holds(points, CLEARANCE_M)] = f"inside '{solid.name}'"
        if self.room is not None:
            low, high = self.room[0] + CLEARANCE_M, self.room[1] - CLEARANCE_M
            found[np.any((points < low) | (points > high), axis=1)] = "outside the room"
        return list(found)

    @cached_property
    def pictures(self) -> list[Bytes]:
        """The picture (h, w, 3) of each face as lit; row 0 is at its corner and edge u."""
        return [self._picture(i, face) for i, face in enumerate(self.faces)]

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

    def _picture(self, index: int, face: Face) -> Bytes:
        width, height = float(np.linalg.norm(face.u)), float(np.linalg.norm(face.v))
        shape = (max(2, round(height * self.texels_per_m)), max(2, round(width * self.texels_per_m)))
        canvas = Canvas((width, height), shape, np.random.default_rng([self.seed, index]))
        picture = face.paint.painter(canvas)
        if not face.paint.glows:
            x, y = canvas.xy
            picture = picture * self.light.on(face, x / width, y / height)[..., None]
        return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8)


def load_world(world: str) -> World:
    """A world that is shipped, by name, or the one in a YAML file."""
    shipped = {Path(str(file)).stem: Path(str(file)) for file in (files("omnilab_mirror") / "worlds").iterdir()}
    file = shipped.get(world, Path(world))
    try:
        return _parse(file, file.read_bytes())
    except OSError as error:
        raise ConfigError(
            f"world={world!r} cannot be read ({error.strerror}); give the path of a YAML file or a name: "
            + suggestion(world, shipped)
        ) from None


@lru_cache(maxsize=4)
def _parse(file: Path, data: bytes) -> World:
    s = read(file, data)
    model = Model(textures(s.section("textures")) if "textures" in s else {})
    x, y = s.size("map_m", 2)
    seed, density = int(s.number("seed", 0, 0, 1e9)), s.number("texels_per_m", 128, 1, 10_000)
    brightness = light(s.section("light")) if "light" in s else Light(1.0, [])
    for entry in s.sections("objects", "object"):
        add_object(entry, model)
    s.done()
    texels = sum(float(np.linalg.norm(np.cross(face.u, face.v))) for face in model.faces) * density**2
    if not model.faces or texels > MAX_TEXELS:
        raise DataError(
            f"{file} needs {texels:.0f} texels; a world needs a face, and up to {MAX_TEXELS} texels: set texels_per_m"
        )
    digest = hashlib.blake2b(data, digest_size=16).hexdigest()
    return World(digest, (x, y), model.faces, model.solids, model.room, brightness, density, seed)
