"""Logging that studies share: layout and room, and one frame with image, panorama, signature and pose."""

from __future__ import annotations

from omnilab.api import Floats, Frames, Image, Pose, Recorder, Sensor, Signature, Tick, ViewLayout
from omnilab.image import panorama

VERDICT_COLORS = "green nearest, amber second, red wrong"  # in titles of maps


def start_logs(record: Recorder, layout: ViewLayout, sensor: Sensor) -> None:
    """The viewer's layout, and the room where the sensor knows it: the first records of a run."""
    record.log("", layout)
    if scene := sensor.scene():
        record.log("room", scene)


def show_frame(record: Recorder, frames: Frames, i: int, signature: Floats, tick: Tick) -> None:
    """Frame i of a batch: image, panorama, signature (...), pose."""
    show_picture(record, frames, i, tick)
    show_signature(record, signature, tick)


def show_picture(record: Recorder, frames: Frames, i: int, tick: Tick) -> None:
    """Frame i of a batch: image, panorama, pose."""
    image = frames.images[i]
    record.log("query/image", Image(image), tick)
    unwrapped = panorama(image[None], frames.camera)[0]
    record.log("query/panorama", Image(unwrapped[:, ::-1]), tick)  # as a person sees it: clockwise to the right
    if frames.T_world_camera is not None:
        record.log("camera", Pose(frames.T_world_camera[i]), tick)


def show_signature(record: Recorder, signature: Floats, tick: Tick) -> None:
    """A signature (...), as a matrix."""
    matrix = signature if signature.ndim == 2 else signature.reshape(1, -1)
    record.log("query/signature", Signature(matrix), tick)
