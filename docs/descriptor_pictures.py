"""Draws the pictures of docs/descriptors.md, after figures of the thesis: uv run python docs/descriptor_pictures.py"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omnilab.api import Bytes, Floats, PathPoses, Signatures
from omnilab.geometry import planar_poses
from omnilab_appearance import Features, Radon, RadonGist, Surf
from omnilab_appearance.altimeters.feature_altitude import common_rotation, derotated
from omnilab_appearance.common.gabor import energies, halved
from omnilab_appearance.common.local_features import LocalFeatures, unpacked
from omnilab_mirror import Mirror

PICTURES = Path(__file__).parent / "pictures"
HERE = (-1.2, -0.6)  # where all images are taken, in metres
TOLERANCE_RAD = np.deg2rad(3.0)
RED, GREEN, YELLOW = "#d1403f", "#2a9d5c", "#f2d024"


class Matches(NamedTuple):
    """Ends (K, 2) of matched features about the centre, in pixels, and the rotation that most of them agree with."""

    reference: Floats
    test: Floats
    rotation_rad: float
    valid: Any  # (K,) whether a match agrees


def images(heights_m: tuple[float, ...], headings_deg: tuple[float, ...]) -> Bytes:
    """Grey mirror images (N, S, S) of the room."""
    sensor = Mirror(size=500)
    positions = np.array([(*HERE, height) for height in heights_m])
    (frames,) = sensor.frames(sensor.plan(PathPoses(planar_poses(positions, np.deg2rad(headings_deg)))))
    return frames.images


def show(axes: Axes, picture: Any, title: str, xlabel: str = "", ylabel: str = "") -> None:
    """A picture in its own grey levels."""
    axes.imshow(picture, cmap="gray", aspect="auto" if xlabel else "equal")
    axes.set_title(title, fontsize=9)
    axes.set(xlabel=xlabel, ylabel=ylabel, xticks=[], yticks=[])


def gist_of_radon() -> Figure:
    """Figures 4.1 and 4.2: the pyramid, the filters' energies, and the descriptor."""
    (image,) = images((1.0,), (0.0,))
    levels = [Radon().describe(image[None]).place]
    for _ in range(3):
        levels.append(halved(levels[-1]))
    figure = Figure(figsize=(11, 7.4), dpi=90, layout="constrained")
    grid = figure.subplots(3, 5, height_ratios=(1.2, 1, 1))
    show(grid[0, 0], image, "image")
    for k, level in enumerate(levels):
        show(grid[0, k + 1], level[0], f"level {k + 1}: {level.shape[1]} x {level.shape[2]}", "angle", "offset")
    for k, row in enumerate(grid[1:]):
        for m, energy in enumerate(energies(levels[k], 4, 0.2)[0]):
            show(row[m], energy, f"level {k + 1}, filter at {45 * m}°", "angle", "offset")
    place = RadonGist().describe(image[None]).place[0]
    for k, axes in enumerate(grid[1:, 4]):
        show(axes, place[k].T, f"gist, level {k + 1}: 16 blocks x 4", "filter", "block")
    return figure


def turn_and_rise() -> Figure:
    """Figures 4.3 and 5.2: what a turn and what a rise do to the Radon transform."""
    shown = images((1.25, 1.25, 2.0), (0.0, 60.0, 0.0))
    transforms = Radon().describe(shown).place
    figure = Figure(figsize=(8.4, 5.6), dpi=90, layout="constrained")
    titles = ("1.25 m high", "turned by 60°: columns shift", "2 m high: offsets are compressed")
    for image, transform, title, column in zip(shown, transforms, titles, figure.subplots(2, 3).T, strict=True):
        show(column[0], image, title)
        show(column[1], transform, "its Radon transform", "angle", "offset")
    return figure


def matches_of(reference: Bytes, test: Bytes) -> Matches:
    """The matches that the altimeter `feature_altitude` finds."""
    known, queried = (unpacked(Signatures(Surf(300).describe(image[None]).place)) for image in (reference, test))
    matched, partner = Features(0.8).matches(LocalFeatures(*(part[0] for part in queried)), known)
    ends = known.xy[0][partner[0, matched[0]]], queried.xy[0][matched[0]]
    return Matches(*ends, *common_rotation(ends[1], ends[0], TOLERANCE_RAD))


def altitude_by_features() -> Figure:
    """Figures 5.5 to 5.8: matches, both images over each other, the rotation, and the test turned back."""
    reference, test = images((1.0, 1.3), (0.0, 40.0))
    found = matches_of(reference, test)
    figure = Figure(figsize=(9, 7.4), dpi=90, layout="constrained")
    axes_of = figure.subplot_mosaic([["side", "side", "side", "turns"], ["over", "over", "last", "last"]])
    side, turns, over, last = (axes_of[name] for name in ("side", "turns", "over", "last"))
    pixels = np.array([1, -1])  # right and down, of right and up
    middle = (len(reference) - 1) / 2
    first, second = (middle + pixels * ends for ends in (found.reference, found.test))
    side.imshow(np.hstack([reference, test]), cmap="gray")
    _connect(side, first, second + np.array([len(reference), 0]))
    side.set_title("matches: reference, test", fontsize=9)
    over.imshow(_red_and_blue(reference, test))
    _connect(over, first, second)
    over.set_title("over each other", fontsize=9)
    differences = np.rad2deg(np.angle(np.exp(1j * _turns(found))))
    turns.hist(differences, np.arange(-180, 181, 6), color="#8b93a1")
    turns.axvline(np.rad2deg(np.angle(np.exp(1j * found.rotation_rad))), color=RED)
    turns.set_title(f"differences of direction [°]:\n{found.valid.sum()} of {len(differences)} agree", fontsize=9)
    turn = cv2.getRotationMatrix2D((middle, middle), np.rad2deg(found.rotation_rad), 1)
    turned = cv2.warpAffine(test, turn, test.shape)
    last.imshow(_red_and_blue(reference, turned))
    _connect(last, first[found.valid], middle + pixels * derotated(found.test[found.valid], found.rotation_rad))
    last.set_title("test turned back: valid matches lead inwards", fontsize=9)
    for axes in (side, over, last):
        axes.set_axis_off()
    return figure


def _turns(found: Matches) -> Floats:
    of_reference, of_test = (np.arctan2(xy[:, 1], xy[:, 0]) for xy in (found.reference, found.test))
    return np.asarray(of_reference - of_test)


def _red_and_blue(reference: Bytes, test: Bytes) -> Bytes:
    return np.stack([reference, np.minimum(reference, test) // 2, test], -1)


def _connect(axes: Axes, first: Floats, second: Floats) -> None:
    axes.plot(*np.stack([first, second]).transpose(2, 0, 1), color=YELLOW, linewidth=0.5)
    axes.plot(*first.T, ".", color=RED, markersize=3)
    axes.plot(*second.T, ".", color=GREEN, markersize=3)


if __name__ == "__main__":
    for name, draw in (("gist", gist_of_radon), ("turn", turn_and_rise), ("features", altitude_by_features)):
        draw().savefig(PICTURES / f"descriptor_{name}.jpg")
