"""Command `omnilab calibrate DIR`: from pictures of a checkerboard to a camera.json, with a report and a picture."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from omnilab.api import Bytes
from omnilab.cameras import save_camera
from omnilab.cameras.calibration import (
    MODELS,
    Board,
    CalibrationResult,
    Corners,
    calibrate,
    read_corners,
    write_corners,
)
from omnilab.errors import ConfigError, visible
from omnilab.file_kinds import is_folder
from omnilab_recordings.checkerboards.coverage_picture import write_coverage_picture
from omnilab_recordings.checkerboards.pictures import FoundBoards, find_boards
from omnilab_recordings.checkerboards.report import boards_table, models_table, print_table, sentences, write_report
from omnilab_recordings.images.decoding import Decoder


@dataclass(frozen=True)
class _Seen:
    """What is calibrated from."""

    corners: Corners
    left_out: dict[str, str]  # pictures without a board, and why
    background: Bytes | None
    rim_px: float | None


def calibrate_command(argv: Sequence[str]) -> int:
    """Calibrate a camera with one viewpoint (a lens, or a mirror with its camera) by pictures of a checkerboard."""
    options = _parser().parse_args(argv)
    board = Board.of_texts(options.board, options.square)
    files = _outputs(options)
    models = [MODELS[name] for name in options.model] if options.model else list(MODELS.values())
    with _progress() as progress:
        seen = _from_file(options, board) if options.corners else _from_pictures(options, board, progress)
        found = calibrate(
            seen.corners, models, options.rim or seen.rim_px, options.inner, options.looks,
            lambda stage: progress(0, 0, f"fitting: {stage}"),
        )  # fmt: skip
    if options.save_corners:
        write_corners(options.save_corners, seen.corners)
    _write(files, found, seen.background)
    _say(found, seen, files)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("omnilab calibrate", description=calibrate_command.__doc__)
    add = parser.add_argument
    add(
        "folder",
        nargs="?",
        metavar="DIR",
        type=Path,
        help="pictures of one board, taken by one camera; nothing is written there",
    )
    add(
        "--board",
        required=True,
        metavar="RxC",
        help="inner corners, where four squares meet: rows x columns, such as 6x7",
    )
    add("--square", required=True, metavar="LENGTH", help="side of a square with its unit, such as 30mm")
    add("-o", "--output", type=Path, default=Path("camera.json"), metavar="FILE",
        help="the camera; beside it FILE_calibration.json with all numbers, and a PNG (%(default)s)")  # fmt: skip
    add("--overwrite", action="store_true", help="replace these files where they are there")
    add(
        "--model",
        action="append",
        choices=list(MODELS),
        help="fit this one only (may be repeated; default: all, the best is chosen)",
    )
    add("--corners", type=Path, metavar="CSV", help="corners by another detector instead: image,row,column,u,v")
    add("--size", metavar="WxH", help="with --corners: size of the pictures, such as 1024x768")
    add("--save-corners", type=Path, metavar="CSV", help="write the corners that were found")
    add(
        "--rim",
        type=float,
        metavar="PX",
        help="radius that shows the world (default: found in the pictures, if it is there)",
    )
    add(
        "--inner",
        type=float,
        default=0.0,
        metavar="PX",
        help="radius inside which the camera sees itself (%(default)g)",
    )
    add(
        "--looks",
        default="down",
        choices=["down", "up", "ahead"],
        help="where the axis points in the camera's frame (%(default)s)",
    )
    add("--pattern", default="**/*", help="which pictures below DIR (%(default)s)")
    add("--bits", type=int, help="of pictures of 16 bits a sample: those that are used, such as 12")
    add("--ignore-exif-orientation", action="store_true", help="take pixels as stored, whatever EXIF tags say")
    return parser


def _outputs(options: argparse.Namespace) -> tuple[Path, Path, Path]:
    """Camera, report and picture; ConfigError where they may not be written."""
    camera: Path = options.output
    if camera.suffix.lower() != ".json" or not is_folder(camera.absolute().parent):
        raise ConfigError(f"the camera cannot be written to {camera}; give -o FILE.json in a folder that exists")
    files = camera, camera.with_name(f"{camera.stem}_calibration.json"), camera.with_suffix(".png")
    if options.folder is not None and camera.resolve().is_relative_to(options.folder.resolve()):
        raise ConfigError(f"{files[2]} would lie among the pictures of {options.folder}; give -o FILE.json, elsewhere")
    outputs = [*files, *([options.save_corners] if options.save_corners else [])]
    if (there := [str(file) for file in outputs if file.exists()]) and not options.overwrite:
        raise ConfigError(f"{', '.join(there)} exist(s); give another -o FILE.json, or --overwrite")
    return files


def _from_pictures(options: argparse.Namespace, board: Board, progress: Callable[[int, int, str], object]) -> _Seen:
    if options.folder is None or not is_folder(options.folder):
        what = "no DIR is given" if options.folder is None else f"{options.folder} is no folder"
        raise ConfigError(f"{what}; give the folder with the pictures of the board, or --corners CSV --size WxH")
    if options.size:
        raise ConfigError(
            f"--size {options.size} is given without --corners; leave it out, the pictures have their size"
        )
    decoder = Decoder(exif_orientation=not options.ignore_exif_orientation, bits=options.bits)
    found: FoundBoards = find_boards(options.folder, options.pattern, board, decoder, progress)
    circle = found.circle() if found.names else None
    return _Seen(found.corners, found.left_out, found.brightest, circle.radius if circle else None)


def _from_file(options: argparse.Namespace, board: Board) -> _Seen:
    width, _, height = (options.size or "").lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and len(width + height) < 12):
        raise ConfigError(
            f"--size {options.size} is no size; with --corners give that of the pictures, such as 1024x768"
        )
    return _Seen(read_corners(options.corners, board, int(width), int(height)), {}, None, None)


def _write(files: tuple[Path, Path, Path], found: CalibrationResult, background: Bytes | None) -> None:
    camera, report, picture = files
    save_camera(found.camera, camera)
    write_report(report, found)
    write_coverage_picture(picture, found, background)


def _say(found: CalibrationResult, seen: _Seen, files: tuple[Path, Path, Path]) -> None:
    print_table(boards_table(found))
    print_table(models_table(found))
    for name, why in seen.left_out.items():
        _print_line(f"left out: {name} {why}")
    for sentence in sentences(found):
        _print_line(sentence)
    _print_line(f"written: {', '.join(map(str, files))}")


def _print_line(line: str) -> None:
    from rich.console import Console

    Console(highlight=False, soft_wrap=True).print(visible(line), markup=False)


@contextmanager
def _progress() -> Iterator[Callable[[int, int, str], object]]:
    """What is being done, on standard error where that is a terminal."""
    from rich.console import Console
    from rich.text import Text

    console = Console(stderr=True)
    with console.status("") as status:
        yield lambda number, count, what: status.update(
            Text(f"{number + 1} of {count}: {visible(what)}" if count else visible(what))
        )
