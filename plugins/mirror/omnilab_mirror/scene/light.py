"""Light of a world as data: ambient light and lamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats
from omnilab_mirror.scene.world_yaml import Section

LAMP_POINTS = 12  # on each lamp's surface, that shadow rays go to: enough for edges that are soft and not stepped


@dataclass(frozen=True)
class Lamp:
    """A small glowing sphere. At `reach_m` its light has fallen to a half; `radius_m` makes its shadows' edges soft."""

    at: Floats
    power: float
    reach_m: float
    radius_m: float = 0.0
    name: str = "lamp"

    def points(self, shadows: bool) -> Floats:
        """Points (n, 3) that stand for the lamp: its middle, or a Fibonacci lattice on its surface."""
        if not shadows or self.radius_m == 0:
            return self.at[None]
        k = np.arange(LAMP_POINTS) + 0.5
        z, turn = 1 - 2 * k / LAMP_POINTS, np.pi * (1 + np.sqrt(5)) * k
        ring = np.sqrt(1 - z**2)
        return np.asarray(self.at + self.radius_m * np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z]))


@dataclass(frozen=True)
class Illumination:
    """What falls on every quad alike, and the lamps, whose light is kept off by all quads that do not glow."""

    ambient: float
    lamps: list[Lamp]
    shadows: bool = True
    skylight: float = 0.0  # added to the ambient light of what faces the sky, taken from what faces away


def light(s: Section, lamps: list[Section]) -> Illumination:
    """The light that the section `light` and those of its `lamps` describe."""
    s.value("lamps", None)
    result = Illumination(s.number("ambient", 0.5, 0, 10), [_lamp(lamp) for lamp in lamps], s.flag("shadows", True))
    s.done()
    return result


def _lamp(s: Section) -> Lamp:
    at, power, reach = np.array(s.numbers("at", 3)), s.number("power", 1.0, 0, 100), s.number("reach_m", 3.0, 0.01, 1e4)
    lamp = Lamp(at, power, reach, s.number("radius_m", 0.1, 0, 100), s.word("name", "lamp"))
    s.done()
    return lamp
