"""Turns of the camera between neighbours, as their pictures show them, against their headings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from omnilab.api import Bytes, Floats, Ints
from omnilab.geometry import heading_of, wrap_angle
from omnilab_recordings.poses.positions import Positions

WAVES = 64  # of a panorama's width that are compared: what is finer differs between places
TELLING = np.sin(np.deg2rad(40.0))  # least sine of a turn that is unlike its opposite
LEAST_PAIRS = 6
AGREE, APART = 0.7, 0.5  # mean cosines: what a reading of the headings needs, and what the given one stays below


@dataclass(frozen=True)
class Turns:
    """Mean cosines (1: full agreement, about 0: none) of turns that M pairs of pictures show and turns by the headings."""

    pairs: int
    as_read: float
    clockwise: float  # if the headings ran the other way, or the pictures were mirrored
    other_unit: float  # if a column of degrees held radians, or one of radians degrees; -1 where it cannot

    @property
    def agree(self) -> bool:
        """Whether the pictures turn as the headings do, and not the other way."""
        return self.pairs >= LEAST_PAIRS and self.as_read >= AGREE and self.clockwise <= APART

    @property
    def unit_left(self) -> bool:
        """Whether the pictures leave it open that headings are in another unit."""
        return self.pairs == 0 or self.other_unit > APART

    @property
    def better(self) -> str | None:
        """The other reading, "clockwise" or "other unit", if the pictures speak for it and against the given one."""
        name, best = max(("clockwise", self.clockwise), ("other unit", self.other_unit), key=lambda one: one[1])
        return name if self.pairs >= LEAST_PAIRS and best >= AGREE and self.as_read <= APART else None


def turning_pairs(positions: Positions, other_unit: Floats | None, bases: int) -> Ints:
    """Pairs (M, 2) of images, as near as can be, whose headings (or, read in another unit, `other_unit` (N,)) tell left turns from right ones."""
    readings = [heading_of(positions.R_world_robot)] + ([] if other_unit is None else [other_unit])
    some = np.unique(np.linspace(0, len(positions.images) - 1, bases).astype(int))
    return np.array([pair for base in some for pair in _from(base, positions, readings)], np.int64).reshape(-1, 2)


def _from(base: int, positions: Positions, readings: list[Floats]) -> Iterator[tuple[int, int]]:
    away = np.linalg.norm(positions.position_m - positions.position_m[base], axis=1)
    telling = np.any([np.abs(np.sin(heading - heading[base])) > TELLING for heading in readings], axis=0)
    if telling.any():
        yield base, int(np.argmin(np.where(telling, away, np.inf)))


def turn_between(first: Bytes, second: Bytes) -> float:
    """The angle in radians by which a camera turned counter-clockwise, as two panoramas (rows, columns) show it.

    The peak of their correlation along the azimuth, whitened by half (between plain and phase-only correlation).
    """
    a, b = (np.fft.rfft(p - p.mean(axis=1, keepdims=True), axis=1)[:, :WAVES] for p in (first.astype(float), second))
    cross = (a * b.conj()).sum(axis=0)
    whitened = cross / np.sqrt(np.abs(cross) + 1e-9)
    columns = first.shape[1]
    return float(2 * np.pi / columns * np.fft.irfft(whitened, columns).argmax())


def compare_turns(seen_rad: Floats, headings: Floats, other_unit: Floats | None, pairs: Ints) -> Turns:
    """Turns (M,) that pictures of pairs (M, 2) show, against headings (N,) and these in another unit (N,)."""
    if not seen_rad.any():  # no pair, or nothing in the pictures that turns
        return Turns(0, 0.0, 0.0, -1.0)

    def agreement(angles: Floats) -> float:
        return float(np.cos(seen_rad - wrap_angle(angles[pairs[:, 1]] - angles[pairs[:, 0]])).mean())

    return Turns(
        len(pairs), agreement(headings), agreement(-headings), -1.0 if other_unit is None else agreement(other_unit)
    )
