"""Recording: the images of a folder and, where a positions file or their names give them, their poses."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePosixPath

import numpy as np

from omnilab.api import Bools, GridPoses, Ints, NamedPath, PathPoses, PoseRequest, RecordedPoses
from omnilab.errors import ConfigError, DataError
from omnilab.file_kinds import how_to_export, is_file, kind_of_file
from omnilab.trajectory.tables import read_table
from omnilab_recordings.images.files import SUFFIXES, as_on_disk, existing, image_names
from omnilab_recordings.poses.filename_poses import Naming, positions_of
from omnilab_recordings.poses.grid import PositionGrid, find_grid, on_grid
from omnilab_recordings.poses.positions import Positions, positions_in
from omnilab_recordings.poses.trajectory_poses import poses_of_images

POSITIONS_FILE = "positions.csv"
STAMPS_FILE = "stamps.csv"  # of a data set without positions: when its images were taken
STAMP_STEP_NS = 100_000_000  # between images of a recording without stamps
SHOWN = 3  # names in a message


@dataclass(frozen=True)
class Recording:
    """N images below a folder, in the order of the positions file or, without one, of their names."""

    folder: Path
    images: Sequence[str]  # (N,)
    positions: Positions | None
    poses_of: str = ""  # what gave the positions: a file, or the names
    times_ns: Ints | None = None  # (N,) where a file says them, and no positions

    def rows(self, layout: PoseRequest) -> Ints:
        """Rows of the images that a layout takes; DataError, with what there is, where it takes none."""
        if isinstance(layout, RecordedPoses):
            taken = np.ones(len(self.images), bool) if layout.without is None else ~self._on_grid(layout.without)
        elif isinstance(layout, GridPoses):
            taken = self._on_grid(layout)
        else:
            wanted = "on a given path" if isinstance(layout, PathPoses | NamedPath) else "at random poses"
            raise DataError(f"{self}, and none {wanted}; {self._remedy}")
        if not taken.any():
            raise DataError(f"{self}, and none {_in_words(layout)}; {self._remedy}")
        return np.flatnonzero(taken)

    def stamps_ns(self, names: Iterable[str]) -> Ints:
        """When images were taken (n,), int64: as recorded or, where that is not known, ten a second."""
        rows = np.array([self._row[name] for name in names], np.int64)
        recorded = self.times_ns if self.positions is None else self.positions.stamps_ns
        return rows * STAMP_STEP_NS if recorded is None else recorded[rows]

    @cached_property
    def _row(self) -> dict[str, int]:
        return {name: row for row, name in enumerate(self.images)}

    def _on_grid(self, layout: GridPoses) -> Bools:
        if self.positions is None or self.grid is None:
            raise DataError(f"{self}, so no grid can be taken from it; {self._remedy}")
        return on_grid(layout, self.grid, self.positions.position_m)

    @cached_property
    def grid(self) -> PositionGrid | None:
        """The grid that the positions form, if they do."""
        return None if self.positions is None else find_grid(self.positions)

    @property
    def _is_one_place(self) -> bool:
        """Whether several images are said to have been taken at one position, as far as a grid tells positions apart."""
        return len(self.images) > 1 and self.grid is not None and not np.ptp(self.grid.cells, axis=0).any()

    @property
    def _remedy(self) -> str:
        if self.positions is None:
            return f"ask for all that was recorded, give sensor.names, or write a {POSITIONS_FILE}"
        if self._is_one_place:
            return "ask for all that was recorded, or mend the positions, which are in metres"
        if self.grid is None:
            return "ask for all that was recorded, or add the columns ix and iy (the place in the grid)"
        return "ask for a grid of its rows and columns, or for what was recorded beside it, e.g. study.queries=rest, of robustness study.every=2"

    def __str__(self) -> str:
        where = "without positions"
        if self.positions is not None:
            where = "at positions that form no grid" if self.grid is None else f"on a {self.grid}"
            where = "at one and the same position" if self._is_one_place else where
        return f"the folder {self.folder} holds {len(self.images)} images {where}"


def _in_words(layout: GridPoses | RecordedPoses) -> str:
    """Which images a layout takes, for a sentence on there being none."""
    if isinstance(layout, RecordedPoses):
        assert layout.without is not None
        return f"besides those {_in_words(layout.without)}"
    count = "every row and column" if layout.every in (None, 1) else f"each {layout.every} rows and columns"
    lines = count if layout.step_m is None else f"{layout.step_m} m"
    area = "" if layout.extent_m is None else f" within {layout.extent_m[0]} x {layout.extent_m[1]} m"
    height = "" if layout.height_m is None else f" at a height of {layout.height_m} m"
    return f"on a grid of {lines}{area}{height}"


def open_recording(
    folder: Path, positions: str | None, pattern: str, not_images: Iterable[str] = (), names: Naming | None = None
) -> Recording:
    """List the images of a folder and read its positions file, or their names.

    DataError unless the positions file names the images that lie beside those it names, and no others. Names that differ
    in nothing but Unicode's forms (composed by one system, decomposed by another) are the same.
    """
    if not _is_folder(folder):
        raise _no_folder(folder)
    aside = {os.path.realpath(folder / name) for name in not_images if "\0" not in name}
    found = [name for name in image_names(folder, pattern) if os.path.realpath(folder / name) not in aside]
    if not found:
        endings = " ".join(sorted(SUFFIXES))
        lost = [file for file in folder.iterdir() if file.is_symlink() and not file.exists()]
        links = f", and {lost[0].name} is a link to {lost[0].readlink()}, which is not there" if lost else ""
        raise DataError(
            f"the folder {folder} holds no image that matches {pattern} ({endings}){links}; give sensor.path=DIR"
        )
    if names is not None:
        _check_no_file(folder, positions)
        return Recording(folder, found, positions_of(found, names), "poses in names")
    known = _positions_of(folder, positions, found)
    if known is None:
        return Recording(
            folder, found, None, times_ns=_times_of(folder, found) if positions == POSITIONS_FILE else None
        )
    known = replace(known, images=as_on_disk(known.images, found))
    beside = {str(PurePosixPath(name).parent) for name in known.images}
    found = [name for name in found if str(PurePosixPath(name).parent) in beside]
    _check_same(folder / str(positions), known.images, found)
    return Recording(folder, known.images, known, str(folder / str(positions)))


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError as error:  # no permission, or no name that can be
        raise DataError(
            f"the folder {str(path)[:200]} cannot be read ({error.strerror}); give sensor.path=DIR"
        ) from error


def _no_folder(path: Path) -> DataError:
    if not path.exists():
        return DataError(f"the folder {path} does not exist; give sensor.path=DIR, a folder of images")
    kind = kind_of_file(path) or "a file"
    remedy = "give sensor.path=DIR, a folder of images"
    if log := how_to_export(path, kind):
        remedy = f"export its images into a folder and give sensor.path=DIR; for its poses, {log} (sensor.positions)"
    return DataError(f"{path} is {kind}, no folder of images; {remedy}")


def _positions_of(folder: Path, positions: str | None, found: Sequence[str]) -> Positions | None:
    if positions is None:
        return None
    file = existing(folder / positions)
    if not os.path.lexists(file):
        if positions == POSITIONS_FILE:  # the default
            return None
        raise DataError(f"the positions file {folder / positions} does not exist; give sensor.positions=FILE or null")
    table = read_table(file)
    return poses_of_images(table, found) if table.is_trajectory else positions_in(table)


def _times_of(folder: Path, found: Sequence[str]) -> Ints | None:
    """The times of images (N,) that `stamps.csv` says; None without it. DataError if it is not of these images."""
    file = folder / STAMPS_FILE
    if not is_file(file):
        return None
    table = read_table(file)
    if (stamps := table.stamps_ns()) is None or table.images() != list(found):
        raise DataError(f"{file} does not name the times of the {len(found)} images there; mend it, or remove it")
    return stamps


def _check_no_file(folder: Path, positions: str | None) -> None:
    if positions is not None and (positions != POSITIONS_FILE or is_file(folder / positions)):
        raise ConfigError(
            f"poses are given by {folder / positions} and by sensor.names;"
            " give sensor.positions=null to take the names, or leave sensor.names out"
        )


def _check_same(file: Path, named: Sequence[str], found: Sequence[str]) -> None:
    absent = sorted(set(named) - set(found))
    unnamed = sorted(set(found) - set(named))
    problems = [f"names {name} twice, in two forms of Unicode" for name in _twice(named)[:1]]
    if absent:
        problems.append(f"names {len(absent)} images that are not there ({_first(absent)})")
    if unnamed:
        problems.append(f"does not name {len(unnamed)} that are ({_first(unnamed)})")
    if problems:
        raise DataError(
            f"{file} {' and '.join(problems)}; mend its rows, or narrow sensor.pattern to the images it names"
        )


def _twice(names: Sequence[str]) -> list[str]:
    return [name for name, times in Counter(names).items() if times > 1]


def _first(names: Sequence[str]) -> str:
    return ", ".join(names[:SHOWN]) + (", ..." if len(names) > SHOWN else "")
