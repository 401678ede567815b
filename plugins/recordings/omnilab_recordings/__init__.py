"""Recorded omnidirectional images as sensors, and recorded odometry."""

from omnilab import hookimpl
from omnilab.hooks import CommandIn, Register, RegisterCommand
from omnilab_recordings.bags.sensors import Mcap, RosBag
from omnilab_recordings.folder import Folder
from omnilab_recordings.recorded import Recorded
from omnilab_recordings.sequences.sensor import ImageSequence
from omnilab_recordings.video.camera import LiveCamera
from omnilab_recordings.video.sensor import Video

__all__ = [
    "Folder",
    "ImageSequence",
    "LiveCamera",
    "Mcap",
    "Recorded",
    "RosBag",
    "Video",
    "register_commands",
    "register_odometries",
    "register_sensors",
]


@hookimpl
def register_sensors(register: Register) -> None:
    register("folder", Folder)
    register("mcap", Mcap)
    register("rosbag", RosBag)
    register("sequence", ImageSequence)
    register("video", Video)
    register("camera", LiveCamera)


@hookimpl
def register_odometries(register: Register) -> None:
    register("recorded", Recorded)


@hookimpl
def register_commands(register: RegisterCommand) -> None:
    register("check", CommandIn("omnilab_recordings.checks.command", "check"))
    register("convert", CommandIn("omnilab_recordings.conversion.command", "convert"))
    register("dataset", CommandIn("omnilab_recordings.published.dataset_command", "dataset"))
    register("calibrate", CommandIn("omnilab_recordings.checkerboards.command", "calibrate_command"))
    register("camera", CommandIn("omnilab_recordings.checkerboards.camera_command", "camera_command"))
