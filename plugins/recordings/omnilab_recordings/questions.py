"""What the poses of a folder may have been meant to be: the same questions for a run and for `omnilab check`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from omnilab.api import Bytes, Ints
from omnilab.errors import DataError
from omnilab.geometry import heading_of, poses
from omnilab.image import panorama
from omnilab.trajectory import plausibility
from omnilab.trajectory.files import Trajectory
from omnilab_recordings.checks.turns import Turns, compare_turns, turn_between, turning_pairs
from omnilab_recordings.poses.grid import PositionGrid
from omnilab_recordings.poses.positions import Positions

if TYPE_CHECKING:
    from omnilab_recordings.folder import Folder

BASES = 16  # images that are compared with a neighbour
SHAPE = (32, 512)  # of their panoramas
MANY = 8  # images that anything is concluded from
FILLED, LINES, SHARE = (
    0.2,
    3,
    8,
)  # of a grid by chance: less of its places, more lines, and each a small part of the images


def questions(sensor: Folder) -> list[str]:
    """Sentences about poses that may be meant otherwise than they are read; none for most folders."""
    recording = sensor.recording
    if recording.positions is None:
        return []
    path = trajectory_of(recording.positions)
    open_questions = list(plausibility.about_positions(path))
    if recording.grid is not None and (found := about_grid(recording.positions, recording.grid)):
        open_questions.append(found)
    if sensor.headings is None:
        turns = seen_turns(sensor)
        if found := about_turns(turns, path, sensor.mirrored):
            open_questions.append(found)
        elif turns.agree:
            open_questions += plausibility.about_axes(path)
        else:
            open_questions += plausibility.about_headings(path, "give sensor.headings=clockwise")
    return [f"{recording.poses_of}: {question}" for question in open_questions]


def trajectory_of(positions: Positions) -> Trajectory:
    """The poses of a folder as a path."""
    T = poses(positions.position_m, positions.R_world_robot)
    return Trajectory(T, positions.stamps_ns, positions.turn, positions.numbers)


def seen_turns(sensor: Folder) -> Turns:
    """Turns between neighbours as their pictures show them, and as their headings say. Of few pictures, nothing."""
    positions = sensor.recording.positions
    if positions is None or len(positions.images) < MANY:
        return compare_turns(np.zeros(0), np.zeros(0), None, np.zeros((0, 2), np.int64))
    other = plausibility.in_other_unit(trajectory_of(positions))
    pairs = turning_pairs(positions, other, BASES)
    pictures = _panoramas(sensor, np.unique(pairs))
    pairs = pairs[np.isin(pairs, list(pictures)).all(axis=1)]
    seen = np.array([turn_between(pictures[a], pictures[b]) for a, b in pairs.tolist()])
    return compare_turns(seen, heading_of(positions.R_world_robot), other, pairs)


def _panoramas(sensor: Folder, rows: Ints) -> dict[int, Bytes]:
    """Panoramas in grey of those rows of a recording whose pictures can be read."""
    found: dict[int, Bytes] = {}
    for row in rows.tolist():
        try:
            (frames,) = sensor.frames(sensor.plan_of(np.array([row])))
        except DataError:
            continue  # it is told when it is needed
        grey = frames.images if frames.images.ndim == 3 else frames.images.mean(-1).astype(np.uint8)
        found[row] = panorama(grey, frames.camera, SHAPE)[0]
    return found


def about_turns(turns: Turns, path: Trajectory, mirrored: bool) -> str | None:
    """Headings against the pictures' own turns: clockwise, or in another unit."""
    pairs = f"{turns.pairs} pairs of neighbours agree to"
    if turns.better == "other unit":
        so = f"as their pictures do ({pairs} {turns.other_unit:.2f}, to {turns.as_read:.2f} as they are read)"
        return f"{plausibility.unit_remedy(path)}: then they turn {so}"
    if turns.better is None:
        return None
    found = f"headings turn against the pictures ({pairs} {turns.clockwise:.2f} the other way round, to {turns.as_read:.2f} as they are)"
    other = f"sensor.mirrored={str(not mirrored).lower()}"
    return f"{found}; if headings run clockwise, {plausibility.clockwise_remedy(path, 'give sensor.headings=clockwise')}; if pictures are mirrored, {other}"


def about_grid(positions: Positions, grid: PositionGrid) -> str | None:
    """Rows and columns that the positions contradict, or that they form by chance, being rounded."""
    if len(positions.images) < MANY:
        return None
    xy = positions.position_m[:, :2]
    if positions.cells is not None:
        cells = np.column_stack([grid.cells, np.ones(len(xy))])
        off = np.linalg.norm(cells @ np.linalg.lstsq(cells, xy, rcond=None)[0] - xy, axis=1)
        spacing = grid.spacing_m[grid.spacing_m > 0].min(initial=np.inf)
        if np.median(off) <= 0.5 * spacing or not np.isfinite(spacing):
            return None
        return f"ix and iy contradict x and y (half the images lie over {np.median(off):.3g} m from their place); mend one of them"
    lines = [np.unique(line, return_counts=True)[1] for line in grid.cells.T]
    filled, places = len(np.unique(grid.cells, axis=0)), len(lines[0]) * len(lines[1])
    along = max(line.max() for line in lines)
    if filled > FILLED * places or min(map(len, lines)) <= LINES or along > max(LINES, len(xy) / SHARE):
        return None
    return (
        f"the {grid} has an image at {filled} of its {places} places: positions"
        " that are but rounded, or a path, form no grid; ask for all that was recorded"
    )
