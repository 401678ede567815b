"""Check of a folder of images before it is used in a study: one pass over the files, and findings in sentences."""

from __future__ import annotations

import hashlib
import itertools
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from omnilab.api import Bools, Bytes, Camera
from omnilab.cameras import ImageCircle, RayCamera
from omnilab.errors import DataError
from omnilab_recordings.checks.handedness import Handedness, Horizon
from omnilab_recordings.folder import Folder
from omnilab_recordings.images.decoding import DecodedImage, Decoder, reduce_by, reduction
from omnilab_recordings.images.files import read_bytes
from omnilab_recordings.optics import circle_of
from omnilab_recordings.poses.positions import Positions
from omnilab_recordings.recording import Recording
from omnilab_recordings.remarks import of_file

MOST = 2000  # images that are read; of more, as many from all over the recording
MOST_CELLS = 10**6  # of a grid, to look for holes in
SHOWN = 4  # names in a sentence
DARK, BLOWN, BLOWN_SHARE = 25.0, 250, 0.1  # grey levels, and the share of a picture that may be blown
SURE_PX = 2.0  # that the circles found in halves of the sample may differ by
BRIGHTER = 12.0  # grey levels that one side of the ring must be brighter by to be called sky


@dataclass(frozen=True)
class Finding:
    """One line of the report. `mark` is "ok", "look" (it may spoil a study) or "?" (it cannot be decided)."""

    topic: str
    mark: str
    text: str


@dataclass(frozen=True)
class CheckedFile:
    """What was found in one file."""

    name: str
    error: str = ""
    size: tuple[int, int] = (0, 0)  # width, height
    digest: str = ""  # of the pixels
    deep: bool = False  # more than 8 bits a sample
    remarks: Mapping[str, str] = field(default_factory=dict)  # by topic
    mean: float | None = None  # grey level where the picture shows the world; None: it has another size
    blown: float = 0.0  # share of that which is at BLOWN or above


def check_files(sensor: Folder) -> list[CheckedFile]:
    """Read images of a folder, at most MOST of them."""
    names, camera = sensor.recording.images, sensor.optics.camera
    chosen = np.unique(np.linspace(0, len(names) - 1, min(len(names), MOST)).astype(int))
    factor = reduction((camera.height, camera.width))
    v, u = np.indices((camera.height // factor, camera.width // factor)) * factor + (factor - 1) / 2
    ring = camera.circle
    distance = np.hypot(u - ring.cx, v - ring.cy)
    shown = (distance <= ring.radius) & (distance >= ring.inner) if ring.radius else np.ones(v.shape, bool)
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(partial(_checked, sensor, shown, factor), [names[at] for at in chosen]))


def _checked(sensor: Folder, shown: Bools, factor: int, name: str) -> CheckedFile:
    decoder = Decoder(exif_orientation=sensor.exif_orientation, bits=sensor.bits)
    try:
        image = decoder.decode(read_bytes(sensor.root, name), name)
    except DataError as error:
        return CheckedFile(name, str(error))
    size = (image.shape[1], image.shape[0])
    digest = hashlib.sha256(repr(size).encode() + image.pixels.tobytes()).hexdigest()
    about = of_file(image, sensor.exif_orientation)
    if size != (sensor.optics.camera.width, sensor.optics.camera.height):
        return CheckedFile(name, "", size, digest, image.deep, about)
    world = reduce_by(image.pixels, factor)[shown]
    return CheckedFile(name, "", size, digest, image.deep, about, float(world.mean()), float((world >= BLOWN).mean()))


# ------------------------------------------------------------------------------------------------------------- files
def of_files(files: Sequence[CheckedFile], count: int) -> Iterator[Finding]:
    """Sizes, files that cannot be read, and files with the same pixels."""
    good = [file for file in files if not file.error]
    sizes = Counter(file.size for file in good).most_common()
    (width, height), _ = sizes[0]
    some = f", of which {len(files)} were read" if len(files) < count else ""
    yield Finding("images", "ok", f"{count} images{some}, {width} x {height} pixels")
    others = [f"{file.name} ({file.size[0]} x {file.size[1]})" for file in good if file.size != (width, height)]
    if others:
        yield Finding("sizes", "look", f"{len(others)} have another size: {first(others)}")
    bad = [file.error for file in files if file.error]
    if bad:
        yield Finding("unreadable", "look", f"{len(bad)} cannot be read: {first(bad)}")
    alike = defaultdict(list)
    for file in good:
        alike[file.digest].append(file.name)
    groups = [" = ".join(names[:SHOWN]) for names in alike.values() if len(names) > 1]
    if groups:
        yield Finding("duplicates", "look", f"{len(groups)} groups of files have the same pixels: {first(groups)}")


def of_exposure(files: Sequence[CheckedFile]) -> Iterator[Finding]:
    """Pictures that are too dark, blown out, or lit unlike the others."""
    measured = {file.name: file.mean for file in files if file.mean is not None}
    means = np.array(list(measured.values()))
    middle = float(np.median(means))
    usual = max(25.0, 4 * float(np.median(np.abs(means - middle))))
    dark = [name for name, mean in measured.items() if mean < DARK]
    blown = [file.name for file in files if file.blown > BLOWN_SHARE]
    odd = [name for name, mean in measured.items() if abs(mean - middle) > usual]
    yield Finding("exposure", "look" if dark or blown or odd else "ok", f"median grey level {middle:.0f}"
        + _counted(dark, f"darker than {DARK:.0f}") + _counted(blown, f"with over {BLOWN_SHARE:.0%} of the pixels at white")
        + _counted(odd, "lit unlike the others"))  # fmt: skip


def _counted(names: Sequence[str], what: str) -> str:
    return f"; {len(names)} {what} ({first(names)})" if names else ""


def first(texts: Sequence[str]) -> str:
    """The first few of many."""
    return ", ".join(texts[:SHOWN]) + (", ..." if len(texts) > SHOWN else "")


# ------------------------------------------------------------------------------------------------------------- optics
def of_circle(sensor: Folder, camera: Camera, sample: Sequence[DecodedImage]) -> Finding:
    """The ring that shows the world, and how sure that is."""
    ring = camera.circle
    where = f"centre ({ring.cx:.1f}, {ring.cy:.1f}), radius {ring.radius:.1f}" + (
        f", inner radius {ring.inner:.1f}" if ring.inner else ""
    )
    if isinstance(camera, RayCamera):
        return Finding(
            "camera", "ok", f"{type(camera).__name__}; {where if ring.radius else 'a panorama, without circle'}"
        )
    if sensor.circle_px is not None:
        return Finding("circle", "ok", f"{where}, as given")
    if sensor.guessed_circle:
        return Finding(
            "circle", "?", f"no dark surround to find it by; {where}, inscribed in the frame, is a guess: give --circle"
        )
    return _sure(where, sample)


def _sure(where: str, sample: Sequence[DecodedImage]) -> Finding:
    """Whether the circle is found again in halves of the sample."""
    try:
        one, other = (circle_of(None, half) for half in (sample[::2], sample[1::2] or sample))
    except DataError:
        return Finding("circle", "look", f"{where}, but not found in half of the sample: check it in the picture")
    apart = max(abs(one.cx - other.cx), abs(one.cy - other.cy), abs(one.radius - other.radius))
    mark = "ok" if apart < SURE_PX else "look"
    return Finding("circle", mark, f"{where}; found in the images, halves of the sample agree to {apart:.1f} px")


def of_calibrated_horizon(camera: RayCamera) -> tuple[Finding, float | None]:
    """The elevations that a camera shows, and the share of the panorama's height that lies below the horizon."""
    lowest, highest = camera.elevations_rad
    text = f"the camera shows elevations from {np.rad2deg(lowest):.0f} to {np.rad2deg(highest):.0f} degrees"
    levels = np.linspace(0, 1, 1001)
    z = camera.directions(camera.unwrap(np.zeros(1001), levels))[:, 2]
    if not np.nanmin(z) < 0 < np.nanmax(z):
        return Finding("horizon", "look", f"{text}, which leave out the horizon"), None
    return Finding("horizon", "ok", text), float(levels[np.nanargmin(np.abs(z))])


def of_moving_horizon(camera: ImageCircle, found: Horizon) -> Finding:
    """The horizon that the robot's moves show, and on which side the ground is."""
    ring = camera.circle
    outward = 1 - found.level if camera.sky_inside else found.level
    at = f"about {ring.inner + outward * (ring.radius - ring.inner):.0f} px from the centre: things rise on one side, sink on the other"
    if found.upright is None:
        return Finding("horizon", "?", f"{at}; equally fast, so which side is up cannot be decided")
    if found.upright:
        return Finding("horizon", "ok", f"{at}, faster on the {_side(camera, above=False)}, the ground's")
    return Finding("horizon", "look",
        f"{at}, faster on the {_side(camera, above=True)}: if the ground is there, {_remedy(camera)}")  # fmt: skip


def of_bright_side(camera: ImageCircle, panoramas: Bytes) -> Finding:
    """Which side of the ring may be the sky; the horizon itself cannot be found."""
    third = panoramas.shape[1] // 3
    above, below = (float(part.mean()) for part in (panoramas[:, :third], panoramas[:, -third:]))
    if abs(above - below) < BRIGHTER:
        return Finding("horizon", "?", "cannot tell: neither side of the ring is brighter")
    side = f"cannot tell where; the {_side(camera, above=above > below)} is brighter ({max(above, below):.0f} against {min(above, below):.0f})"
    if above > below:
        return Finding("horizon", "?", f"{side}, as it should if that is the sky")
    return Finding("horizon", "look", f"{side}: if that is the sky, {_remedy(camera)}")


def _side(camera: ImageCircle, above: bool) -> str:
    return "inside" if above == camera.sky_inside else "outside"


def _remedy(camera: ImageCircle) -> str:
    return "leave out --sky-inside" if camera.sky_inside else "give --sky-inside (sensor.sky_inside=true)"


# -------------------------------------------------------------------------------------------------------------- poses
def of_poses(recording: Recording) -> Iterator[Finding]:
    """What is known of where images were taken: extent, grid, holes, poses that occur twice."""
    positions = recording.positions
    if positions is None:
        yield Finding("poses", "?", "none: write a positions.csv, or give --names")
        return
    extent = np.ptp(positions.position_m, axis=0)
    yield Finding("poses", "ok", f"{len(positions.images)}, over {' x '.join(f'{side:.4g}' for side in extent)} m")
    if recording.grid is not None:
        cells = recording.grid.cells - recording.grid.cells.min(0)
        there = set(map(tuple, cells.tolist()))
        columns, rows = (int(most) + 1 for most in cells.max(0))
        among = itertools.product(range(columns), range(rows)) if columns * rows <= MOST_CELLS else ()
        holes = [f"column {x}, row {y}" for x, y in among if (x, y) not in there]
        yield Finding("grid", "look" if holes else "ok", str(recording.grid) + _counted(holes, "places without image"))
    else:
        yield Finding("grid", "?", "the positions form none")
    if twice := _same_poses(positions):
        yield Finding("same pose", "look", f"{len(twice)} pairs of images: {first(twice)}")


def _same_poses(positions: Positions) -> list[str]:
    poses = np.column_stack([positions.position_m.round(4), positions.R_world_robot.reshape(-1, 9).round(4)])
    seen: dict[bytes, str] = {}
    others = [
        seen.setdefault((pose + 0.0).tobytes(), image) for image, pose in zip(positions.images, poses, strict=True)
    ]
    return [f"{other} and {image}" for image, other in zip(positions.images, others, strict=True) if other != image]


def of_handedness(found: Handedness) -> Finding:
    """Whether to flip the pictures, or that it cannot be decided."""
    agreement = f"{found.pairs} moves between neighbours agree to {found.as_taken:.2f} as taken, to {found.mirrored:.2f} flipped"
    if found.is_mirrored is None:
        return Finding(
            "handedness", "?", f"cannot tell whether pictures are mirrored ({agreement}; 1 is full agreement)"
        )
    settings = f"sensor.mirrored={str(found.is_mirrored).lower()} sensor.turned_deg={round(found.turned_deg) % 360}"
    return Finding("handedness", "ok", f"{settings} (the angle to a few degrees): {agreement}")
