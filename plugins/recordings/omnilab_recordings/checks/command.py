"""Command `omnilab check DIR`: sizes, circle, horizon, exposure, poses and handedness of a folder of images."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Bytes, Plan, RecordedPoses
from omnilab.cameras import ImageCircle, RayCamera
from omnilab.errors import ConfigError, DataError, visible
from omnilab.image import panorama
from omnilab_recordings.checks import dataset_check
from omnilab_recordings.checks.dataset_check import Finding
from omnilab_recordings.checks.handedness import Handedness, Horizon, drift_between, handedness, moves_rad, neighbours
from omnilab_recordings.checks.handedness import horizon as horizon_of
from omnilab_recordings.checks.pictures import as_panorama, of_reading
from omnilab_recordings.checks.pose_check import of_meaning
from omnilab_recordings.checks.report_picture import write_report_picture
from omnilab_recordings.folder import SAMPLE, Folder
from omnilab_recordings.images.circle import inscribed
from omnilab_recordings.on_bad_image import OnBadImage
from omnilab_recordings.optics import most_alike
from omnilab_recordings.panoramas import Panorama
from omnilab_recordings.poses.filename_poses import PRESETS

FLOW_SHAPE = (64, 512)  # of the panoramas in which drifts are measured
COLORS = {"ok": "green", "look": "yellow", "?": "cyan"}


def check(argv: Sequence[str]) -> int:
    """Look at a folder of images and say what a study would meet: sizes, circle, horizon, exposure, poses, handedness."""
    options = _parser().parse_args(argv)
    output = _output(options.output, Path(options.folder))
    with _findings_only():
        return _check(options, output)


def _check(options: argparse.Namespace, output: Path) -> int:
    sensor, problem = _with_poses(_sensor(options))
    sensor, circle = _with_circle(sensor)
    sensor, layout = as_panorama(sensor)
    if layout is not None:
        circle = layout
    files = dataset_check.check_files(sensor)
    found, moving = _moves(sensor)
    horizon, level = _horizon(sensor, moving)
    findings = [
        *dataset_check.of_files(files, len(sensor.recording.images)),
        *of_reading(sensor, files),
        circle,
        horizon,
        *dataset_check.of_exposure(files),
    ]
    findings += [problem] if problem else dataset_check.of_poses(sensor.recording)
    findings += of_meaning(replace(sensor, mirrored=bool(found.is_mirrored)))
    if sensor.recording.positions is not None:
        findings.append(dataset_check.of_handedness(found))
    _print(findings, str(options.folder))
    write_report_picture(output, replace(sensor, mirrored=bool(found.is_mirrored)), level, found)
    _print_line(f"picture: {output}")
    return 0


@contextmanager
def _findings_only() -> Iterator[None]:
    """What a run would log as warnings is among the findings."""
    log = logging.getLogger("omnilab")
    log.disabled = True
    try:
        yield
    finally:
        log.disabled = False


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("omnilab check", description=check.__doc__)
    add = parser.add_argument
    add("folder", metavar="DIR", help="images at any depth below it are looked at; nothing is written there")
    add("-o", "--output", type=Path, default=Path("check.png"), metavar="FILE", help="the picture (%(default)s)")
    add("--circle", type=float, nargs="+", metavar="PX", help="centre u and v, radius, and inner radius if need be")
    add("--sky-inside", action="store_true", help="the sky is at the centre")
    add(
        "--panorama",
        choices=[kind.value for kind in Panorama],
        help="the images are panoramas, their middle is the front",
    )
    add("--bits", type=int, help="of images of 16 bits a sample: those that are used, such as 12")
    add("--ignore-exif-orientation", action="store_true", help="take pixels as stored, whatever EXIF tags say")
    add("--names", help=f"poses by file names: {', '.join(PRESETS)}, or a regular expression with named groups")
    add("--spacing", type=float, metavar="M", help="with --names: metres between columns and rows")
    add("--columns", type=int, metavar="N", help="with --names that only count: images in a row")
    add("--height-step", type=float, metavar="M", help="with --names that count levels: metres between two")
    add("--positions", metavar="FILE", help="CSV or trajectory below DIR (positions.csv)")
    add("--pattern", default="**/*", help="which images below DIR (%(default)s)")
    add("--camera", metavar="FILE", help="calibration (formats: docs/cameras.md): below DIR, or a full path")
    add("--looks", help="where the camera looks, if its file does not say: down, up or ahead")
    add("--entry", metavar="CAM", help="which camera of a calibration with several, such as cam1")
    add("--distortion", help="of OpenCV's files that do not say: radtan or equidistant")
    return parser


def _output(file: Path, folder: Path) -> Path:
    if file.resolve().is_relative_to(folder.resolve()):
        raise ConfigError(f"the picture {file} would lie among the images of {folder}; give -o FILE, elsewhere")
    if file.suffix.lower() not in {".png", ".jpg", ".pdf", ".svg"} or not file.absolute().parent.is_dir():
        raise ConfigError(f"the picture cannot be written to {file}; give -o FILE.png in a folder that exists")
    return file


def _sensor(options: argparse.Namespace) -> Folder:
    settings: dict[str, Any] = {"positions": options.positions} if options.positions else {}
    return Folder(
        options.folder, pattern=options.pattern, names=options.names, spacing_m=options.spacing, columns=options.columns,
        height_step_m=options.height_step, camera=options.camera, looks=options.looks, entry=options.entry, distortion=options.distortion, circle_px=options.circle, sky_inside=options.sky_inside,
        panorama=Panorama(options.panorama) if options.panorama else None, bits=options.bits,
        exif_orientation=not options.ignore_exif_orientation, on_bad_image=OnBadImage.skip, **settings,
    )  # fmt: skip


def _with_poses(sensor: Folder) -> tuple[Folder, Finding | None]:
    """The sensor; without poses, and what is wrong with them, if they cannot be read."""
    without = replace(
        sensor, positions=None, names=None, spacing_m=None, columns=None, lowest_m=None, height_step_m=None
    )
    without.recording.rows(RecordedPoses())
    try:
        sensor.recording.rows(RecordedPoses())
    except DataError as error:
        return without, Finding("poses", "look", str(error))
    return sensor, None


def _with_circle(sensor: Folder) -> tuple[Folder, Finding]:
    """The sensor, with the circle inscribed in the frame if none can be found, and the finding about it."""
    sample = most_alike(sensor.sample)
    try:
        return sensor, dataset_check.of_circle(sensor, sensor.optics.camera, sample)
    except DataError as error:
        if sensor.camera_file.read(sensor.root, sample[0].shape[::-1]) is not None:
            raise
        ring = inscribed(sample[0].shape)
        shown = replace(sensor, circle_px=[ring.cx, ring.cy, ring.radius])
        return shown, Finding("circle", "look", f"{error}; shown is the inscribed one")


def _moves(sensor: Folder) -> tuple[Handedness, Horizon | None]:
    """What the pictures of neighbours show of the robot's moves between them."""
    positions = sensor.recording.positions
    pairs = np.zeros((0, 2), np.int64) if positions is None else neighbours(positions)
    rows, seen = np.unique(pairs), dict[int, Bytes]()
    for frames in sensor.frames(sensor.plan_of(rows)):
        seen.update(zip(rows[frames.plan_index], panorama(frames.images, frames.camera, FLOW_SHAPE), strict=True))
    pairs = pairs[np.isin(pairs, list(seen)).all(axis=1)]
    if positions is None or len(pairs) == 0:
        return handedness(np.zeros(0), np.zeros(0)), None
    drifts, parting = zip(*(drift_between(seen[a], seen[b]) for a, b in pairs), strict=True)
    return handedness(np.array(drifts), moves_rad(positions, pairs)), horizon_of(np.stack(parting))


def _horizon(sensor: Folder, moving: Horizon | None) -> tuple[Finding, float | None]:
    """By the calibration, by the moves, or by brightness: the horizon, and its level in the panorama where known."""
    camera = sensor.optics.camera
    if isinstance(camera, RayCamera):
        return dataset_check.of_calibrated_horizon(camera)
    assert isinstance(camera, ImageCircle)
    if sensor.circle_is_doubtful:
        return Finding("horizon", "?", "cannot tell, as the circle is not known"), None
    if moving is not None:
        return dataset_check.of_moving_horizon(camera, moving), moving.level
    panoramas = np.concatenate([panorama(frames.images, camera, FLOW_SHAPE) for frames in sensor.frames(_some(sensor))])
    return dataset_check.of_bright_side(camera, panoramas), None


def _some(sensor: Folder) -> Plan:
    """Some images from all over the recording."""
    plan = sensor.plan(RecordedPoses())
    return plan.at(np.unique(np.linspace(0, len(plan) - 1, SAMPLE).astype(int)))


def _print(findings: Sequence[Finding], title: str) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, show_header=False)
    for finding in findings:
        table.add_row(Text(finding.mark, style=COLORS[finding.mark]), finding.topic, Text(visible(finding.text)))
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(width=max(80, console.measure(table, options=console.options.update(width=10_000)).maximum))
    console.print(visible(title), style="bold", markup=False, soft_wrap=True)
    console.print(table)


def _print_line(line: str) -> None:
    from rich.console import Console

    Console(highlight=False, soft_wrap=True).print(visible(line), markup=False)
