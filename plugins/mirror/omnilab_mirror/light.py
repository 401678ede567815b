"""Light, which is painted into the faces' pictures when a world is loaded: it costs nothing when images are traced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats
from omnilab_mirror.faces import Face
from omnilab_mirror.reader import Section


@dataclass(frozen=True)
class Lamp:
    """A point light. At `reach_m` its light has fallen to a half."""

    at: Floats
    power: float
    reach_m: float


@dataclass(frozen=True)
class Light:
    """What falls on every face alike, and the lamps."""

    ambient: float
    lamps: list[Lamp]
    skylight: float = 0.0  # added to the ambient light of what faces the sky, taken from what faces away

    def on(self, face: Face, x: Floats, y: Floats) -> Floats:
        """Brightness (H, W) at fractions x (1, W) and y (H, 1) of a face's edges: ambient + Lambert's cosine law."""
        points = face.corner + x[..., None] * face.u + y[..., None] * face.v
        normal = np.cross(face.u, face.v)
        normal /= np.linalg.norm(normal)
        brightness = np.full(points.shape[:2], self.ambient)
        for lamp in self.lamps:
            to_lamp = lamp.at - points
            distance = np.linalg.norm(to_lamp, axis=-1)
            cosine = np.maximum(0, to_lamp @ normal) / np.maximum(distance, 1e-9)
            brightness += lamp.power * cosine / (1 + (distance / lamp.reach_m) ** 2)
        return brightness


def light(s: Section) -> Light:
    """The light that the section `light` describes."""
    result = Light(s.number("ambient", 0.5, 0, 10), [_lamp(lamp) for lamp in s.sections("lamps", "lamp")])
    s.done()
    return result


def _lamp(s: Section) -> Lamp:
    at, power, reach = np.array(s.numbers("at", 3)), s.number("power", 1.0, 0, 100), s.number("reach_m", 3.0, 0.01, 1e4)
    s.done()
    return Lamp(at, power, reach)
