"""A virtual world as data: quads with their paints, meshes, light, and where a camera may be."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from omnilab.api import Bytes
from omnilab_mirror.scene.file_stamps import Stamp
from omnilab_mirror.scene.light import Illumination
from omnilab_mirror.scene.meshes.triangles import Triangles
from omnilab_mirror.scene.paths import Route
from omnilab_mirror.scene.quads import Area, Quad, Solid


@dataclass(frozen=True, eq=False)
class World:
    """What a world file or a mesh file describes. Two are equal if they are one object: what is prepared for rendering is kept by it."""

    digest: str  # of the file's content, the variant, and the pictures it names
    map_m: tuple[float, float]  # x and y around the origin
    quads: list[Quad]
    solids: list[Solid]
    areas: list[Area]
    light: Illumination
    texels_per_m: float
    seed: int
    sky: Bytes | None = (
        None  # (h, w, 3): what is seen past all quads, row 0 overhead, column 0 to +x, counter-clockwise
    )
    paths: dict[str, Route] = field(default_factory=dict)
    variants: tuple[str, ...] = ()
    meshes: list[Triangles] = field(default_factory=list)
    contents: list[str] = field(default_factory=list)  # what the mesh files hold, a sentence each
    notes: list[str] = field(default_factory=list)  # what in them was mended, left out or may be meant otherwise
    sources: dict[Path, Stamp] = field(default_factory=dict)  # the other files it is made of
