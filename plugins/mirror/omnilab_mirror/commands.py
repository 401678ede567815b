"""The command `omnilab world`: lists the shipped worlds, summarises a file with its errors and warnings, draws its plan."""

from __future__ import annotations

import argparse
import logging
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omnilab.atomic_files import write_whole
from omnilab.errors import ConfigError, visible

if TYPE_CHECKING:
    from omnilab_mirror.scene.world import World

HEIGHT_M = 1.0  # where the free share of the map is counted: the sensors' default
STEP_M = 0.1
MAX_NODES = 25_000  # at which it is counted; on larger maps they are farther apart


def world_command(argv: list[str]) -> int:
    """The command's exit code: 2 where a file cannot be used."""
    parser = argparse.ArgumentParser(prog="omnilab world", description="Look at virtual worlds.")
    actions = parser.add_subparsers(dest="action", required=True)
    actions.add_parser("list", help="the worlds that are shipped, and their variants")
    check = actions.add_parser("check", help="what is in a world file, and what is wrong with it")
    check.add_argument("world", metavar="FILE", help="a YAML or mesh file, or the name of a shipped world")
    check.add_argument("--variant", help="one of its variants; without it, the world as it is and all its variants")
    check.add_argument("--up", choices=("y", "z"), help="of a mesh file: its axis that points up, as sensor.up")
    check.add_argument("--scale", type=float, default=1.0, help="of a mesh file: metres a unit of it, as sensor.scale")
    plan = actions.add_parser("plan", help="a world from above, with its dimensions, as a PNG")
    plan.add_argument("world", metavar="FILE", help="a YAML or mesh file, or the name of a shipped world")
    plan.add_argument("picture", metavar="PICTURE", type=Path, help="the PNG to write")
    plan.add_argument("--variant", help="one of its variants")
    plan.add_argument("--up", choices=("y", "z"), help="of a mesh file: its axis that points up, as sensor.up")
    plan.add_argument("--scale", type=float, default=1.0, help="of a mesh file: metres a unit of it, as sensor.scale")
    plan.add_argument(
        "--step", type=float, metavar="M", help="also the free places of a grid with this step, in metres"
    )
    plan.add_argument("--height", type=float, metavar="M", default=HEIGHT_M, help="of the camera at these places")
    plan.add_argument("--pixels", type=float, metavar="N", help="a metre; by default 1000 on the longer side")
    chosen = parser.parse_args(argv)
    if chosen.action == "list":
        return _list()
    if chosen.action == "plan":
        return _plan(chosen)
    return _check(chosen.world, chosen.variant, chosen.up, chosen.scale)


def _list() -> int:
    from omnilab_mirror.scene.load import load_world
    from omnilab_mirror.scene.shipped import shipped

    for name, file in shipped().items():
        _say(f"{name}: {', '.join(load_world(name).variants) or 'no variants'}  ({file})")
    return 0


def _plan(chosen: argparse.Namespace) -> int:
    from omnilab.image import encode
    from omnilab_mirror.plan import plan_of
    from omnilab_mirror.scene.load import load_world

    picture: Path = chosen.picture
    if picture.suffix.lower() != ".png":
        raise ConfigError(f"{picture} is no name of a PNG; give one that ends in .png")
    if chosen.pixels is not None and not chosen.pixels > 0:
        raise ConfigError(f"--pixels {chosen.pixels:g} is out of range; give a number above 0, such as 100")
    world = load_world(chosen.world, chosen.variant, chosen.up, chosen.scale)
    if chosen.step is not None:
        _check_step(chosen.step, world)
    drawn = plan_of(world, chosen.pixels, chosen.step, chosen.height)
    try:
        write_whole(picture, lambda file: file.write(encode(drawn, "png")))
    except OSError as error:
        raise ConfigError(
            f"{picture} cannot be written ({error.strerror}); give a file in a folder that is there"
        ) from error
    _say(f"{picture}: {drawn.shape[1]} x {drawn.shape[0]} pixels")
    return 0


def _check_step(step_m: float, world: World) -> None:
    """ConfigError for a grid that nobody could see the places of."""
    if not (step_m > 0 and np.prod([side / step_m + 1 for side in world.map_m]) <= MAX_NODES):
        raise ConfigError(
            f"--step {step_m:g} makes no grid of 1 to {MAX_NODES} places on a map of {world.map_m[0]:g} x"
            f" {world.map_m[1]:g} m; give a step such as 0.2"
        )


def _check(name: str, variant: str | None, up: str | None, scale: float) -> int:
    from omnilab_mirror.lint import warnings_of
    from omnilab_mirror.scene.load import problems_of

    logging.getLogger("omnilab").addHandler(logging.NullHandler())  # the notes are said here
    built, problems = problems_of(name, variant, up, scale)
    worlds = {variant: built}
    if variant is None and built is not None:
        for other in built.variants:
            worlds[other], more = problems_of(name, other, up, scale)
            problems += more
    if built is not None:
        for line in _summary(built):
            _say(line)
    for sentence in dict.fromkeys(map(str, problems)):  # variants share most of them
        _say(f"wrong: {sentence}")
    if problems:
        return 2
    printed: set[str] = set()
    for tag, found in worlds.items():
        for warning in warnings_of(found) if found else ():
            if warning not in printed:
                printed.add(warning)
                _say(f"warning{f' (variant {tag})' if tag else ''}: {warning}")
    return 0


def _summary(world: World) -> Iterator[str]:
    yield from world.contents
    if world.quads:
        yield from _faces(world)
    for area in world.areas:
        x, y, z = area.high - area.low
        yield f"{area.name}: {x:g} x {y:g} m" + (f", {z:g} m high" if z < 500 else "")
    x, y = world.map_m
    yield f"map: {x:.5g} x {y:.5g} m, {free_share(world):.0%} of it free at {HEIGHT_M:g} m"
    if world.quads:
        names = Counter({quad.seed[0]: quad.name for quad in world.quads}.values())
        yield "objects: " + ", ".join(f"{count} {name}" if count > 1 else name for name, count in sorted(names.items()))
    for name, path in world.paths.items():
        yield f"path {name}: {path.length_m:.2f} m, {len(path.poses(HEIGHT_M))} images"
    if world.variants:
        yield "variants: " + ", ".join(world.variants)
    for note in world.notes:
        yield f"note: {note}"


def _faces(world: World) -> Iterator[str]:
    texels = sum(float(np.linalg.norm(np.cross(quad.u, quad.v))) for quad in world.quads) * world.texels_per_m**2
    yield f"{len(world.quads)} faces, {texels / 1e6:.1f} million texels, {len(world.light.lamps)} lamps"


def free_share(world: World) -> float:
    """Of the map's nodes on a grid, at the default height and with a robot below: the share that is free."""
    from omnilab_mirror.render.free_space import obstacles

    step_m = max(STEP_M, float(np.sqrt(np.prod(world.map_m) / MAX_NODES)))
    x, y = (np.arange(-side / 2, side / 2 + 1e-9, step_m) for side in world.map_m)
    points = np.array([(px, py, HEIGHT_M) for py in y for px in x])
    return float(np.mean([not why for why in obstacles(world, points, on_floor=True)]))


def _say(line: str) -> None:
    sys.stdout.write(visible(line) + "\n")
