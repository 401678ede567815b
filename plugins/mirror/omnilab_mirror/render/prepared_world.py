"""Prepared world: lit pictures, atlases and Embree's tree, made before the first ray and once for each world."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from omnilab.api import Bytes
from omnilab_mirror.render.atlas import Atlas, build_atlas
from omnilab_mirror.render.light_baking import bake_pictures
from omnilab_mirror.scene.meshes.triangles import halves, joined
from omnilab_mirror.scene.world import World

if TYPE_CHECKING:
    from omnilab_mirror.render.embree import Embree

T = TypeVar("T")


def once_per_world(make: Callable[[World], T]) -> Callable[[World], T]:
    """The function, with its results kept as long as their worlds; they must not hold the world themselves."""
    made: WeakKeyDictionary[World, T] = WeakKeyDictionary()

    @wraps(make)
    def kept(world: World) -> T:
        if world not in made:
            made[world] = make(world)
        return made[world]

    return kept


@once_per_world
def baked_pictures(world: World) -> list[Bytes]:
    """The picture (h, w, 3) of each quad as lit; row 0 is at its corner and edge u."""
    return bake_pictures(world)


@once_per_world
def gray_atlas(world: World) -> Atlas:
    """The luma of the pictures, and of the sky, at all resolutions."""
    return build_atlas([*baked_pictures(world), *_sky_picture(world)], color=False)


@once_per_world
def color_atlas(world: World) -> Atlas:
    """The pictures, and the sky, at all resolutions."""
    return build_atlas([*baked_pictures(world), *_sky_picture(world)], color=True)


@once_per_world
def embree_of(world: World) -> Embree:
    """Meshes and quads as triangles, ready for rays."""
    from omnilab_mirror.render.embree import Embree

    quads = [halves(world.quads, baked_pictures(world))] if world.quads else []
    return Embree(joined([*world.meshes, *quads]), world.light, world.sky)


def _sky_picture(world: World) -> list[Bytes]:
    """The sky twice, side by side, so that it goes on at its edges; none where there is no sky."""
    return [] if world.sky is None else [np.hstack([world.sky, world.sky])]
