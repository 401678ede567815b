"""The boards in a folder of pictures."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from omnilab.api import Bytes, Circle, Floats
from omnilab.cameras.calibration import Board, Corners, find_corners, other_board, whole_size
from omnilab.errors import ConfigError, DataError
from omnilab_recordings.images.circle import find_circle, inscribed
from omnilab_recordings.images.decoding import Decoder
from omnilab_recordings.images.files import image_names, read_bytes
from omnilab_recordings.images.headers import ImageHeader, read_header

TRIED = 5  # pictures without a board, after which boards of other sizes are looked for
TOO_SMALL = 0.5  # of the boards go on beyond the corners that were asked for: then it is another board


@dataclass
class FoundBoards:
    """What the pictures of a folder show."""

    board: Board
    names: list[str] = field(default_factory=list)  # with a board
    pixels: list[Floats] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)  # without one, and why
    brightest: Bytes | None = None  # (H, W) of all pictures
    longer: list[tuple[int, int]] = field(default_factory=list)  # of boards that go on: rows and columns
    without: list[Bytes] = field(default_factory=list)  # some of the pictures without a board

    @property
    def corners(self) -> Corners:
        """The corners of all boards."""
        assert self.brightest is not None
        height, width = self.brightest.shape
        pixels = np.array(self.pixels).reshape(-1, self.board.rows * self.board.columns, 2)
        return Corners(self.board, width, height, tuple(self.names), pixels)

    def circle(self) -> Circle | None:
        """The image circle, if a dark surround shows it and it holds all corners."""
        assert self.brightest is not None
        try:
            circle = find_circle(self.brightest[None])
        except DataError:  # a dark surround without a circle
            return None
        away = np.linalg.norm(self.corners.pixels - [circle.cx, circle.cy], axis=-1)
        beyond = circle == inscribed(self.brightest.shape) or np.nanmax(away) > circle.radius
        return None if beyond else circle


def find_boards(
    folder: Path, pattern: str, board: Board, decoder: Decoder, progress: Callable[[int, int, str], object]
) -> FoundBoards:
    """Look for the board in each picture of a folder; `progress` is told number, count and name.

    A picture that cannot be read, or shows no board, is left out. DataError for pictures of different sizes or turned
    in different ways, ConfigError for a board that has other counts of corners.
    """
    names = image_names(folder, pattern)
    if not names:
        raise DataError(f"{folder} holds no pictures ({pattern}); give the folder with the pictures of the board")
    _check_alike(folder, names, decoder)
    found = FoundBoards(board)
    for number, name in enumerate(names):
        progress(number, len(names), name)
        try:
            _search(found, decoder.decode(read_bytes(folder, name), name).pixels, name)
        except DataError as error:
            found.left_out[name] = str(error)
        if len(found.without) == TRIED and not found.names:
            _refuse_other(found)
    if found.brightest is None:
        raise DataError(f"{folder}: no picture can be read ({next(iter(found.left_out.values()))})")
    if len(found.longer) > TOO_SMALL * len(found.names):
        _refuse_longer(found)
    if len(found.names) < TRIED:
        _refuse_other(found)
    return found


def _search(found: FoundBoards, image: Bytes, name: str) -> None:
    found.brightest = image if found.brightest is None else np.maximum(found.brightest, image)
    pixels = find_corners(image, found.board)
    if pixels is None:
        found.left_out[name] = f"shows no board of {found.board} inner corners"
        if len(found.without) < TRIED:
            found.without.append(image)
        return
    found.names.append(name)
    found.pixels.append(pixels)
    size = whole_size(image, pixels, found.board)
    if size != (found.board.rows, found.board.columns):
        found.longer.append(size)


def _check_alike(folder: Path, names: list[str], decoder: Decoder) -> None:
    """DataError for pictures of several sizes, or that tags turn in several ways; what cannot be read is said later."""
    sizes: dict[str, list[str]] = defaultdict(list)
    turns: dict[str, list[str]] = defaultdict(list)
    for name in names:
        header = _header(folder, name)
        if header is not None:
            width, height = header.width, header.height
            if decoder.exif_orientation and header.orientation > 4:
                width, height = height, width
            sizes[f"{width} x {height}"].append(name)
            turns[f"orientation {header.orientation}"].append(name)
    if decoder.exif_orientation and len(turns) > 1:
        raise DataError(
            f"the pictures are turned in {len(turns)} ways by their EXIF tags ({_examples(turns)}), and a camera's axis lies"
            " elsewhere in each; give --ignore-exif-orientation, and in runs sensor.exif_orientation=false"
        )
    if len(sizes) > 1:
        raise DataError(
            f"the pictures have {len(sizes)} sizes ({_examples(sizes)}); give those of one camera at one size, such as"
            " --pattern 'board*.png'"
        )


def _header(folder: Path, name: str) -> ImageHeader | None:
    try:
        return read_header(read_bytes(folder, name), name)
    except DataError:
        return None


def _examples(groups: dict[str, list[str]]) -> str:
    return ", ".join(f"{key}: {len(names)}, such as {names[0]}" for key, names in groups.items())


def _refuse_other(found: FoundBoards) -> None:
    """ConfigError if a board of other counts is in the pictures that show none."""
    other = other_board(found.without[:3], found.board)
    if other is not None:
        raise ConfigError(
            f"{len(found.names)} of the pictures show a board of {found.board} inner corners, and others one of {other}; give"
            f" --board {other} (it counts corners where four squares meet, not squares)"
        )


def _refuse_longer(found: FoundBoards) -> None:
    fewer, more = np.sort(found.longer, axis=1).max(0)
    raise ConfigError(
        f"the board goes on beyond {found.board} inner corners in {len(found.longer)} of {len(found.names)} pictures, to"
        f" {fewer}x{more} or more; count the corners where four squares meet, and give --board {fewer}x{more} or what you count"
    )
