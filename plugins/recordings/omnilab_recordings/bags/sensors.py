"""Sensors `rosbag` and `mcap`: the images of a robot's log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from omnilab_recordings.bags.bag_stream import BagStream, Stamps
from omnilab_recordings.bags.camera_poses import Axes, CameraPoses
from omnilab_recordings.bags.choice import image_topic
from omnilab_recordings.bags.log_index import LogIndex
from omnilab_recordings.panoramas import Panorama
from omnilab_recordings.streams.image_stream import ImageStream
from omnilab_recordings.streams.sensor import StreamSensor


@dataclass
class RosBag(StreamSensor):
    """A topic of images in a bag of ROS 1 (.bag) or ROS 2 (its folder, .db3, .mcap), or in an MCAP log.

    The log is gone through once, and then each image is read where it lies. Messages are sensor_msgs/Image and
    CompressedImage (or Foxglove's); the camera is that of a CameraInfo beside them, poses are those of /tf or of a topic
    (Odometry, PoseStamped and the like). ROS's frames are turned to omnilab's, as `axes` and `looks` have it. Types are
    read by definitions that are known here, never by the bag's own.
    """

    topic: str | None = None  # of the images; null: the only one
    stamps: Stamps = Stamps.header  # when images were taken: header, or record
    camera_info: str | None = None  # the topic of the calibration; null: the one beside the images
    poses: str | None = None  # the topic of poses; null: the tree of frames (/tf), if the images' frame is in it
    world: str | None = None  # the frame of the poses in that tree; null: its root
    axes: Axes | None = (
        None  # of the images' frame: optical (z ahead) or body (z up); null: optical if its name says so
    )

    def open_stream(self) -> ImageStream:
        """The images; DataError or ConfigError with the topics that there are, where none or several have images."""
        log = LogIndex(Path(self.path))
        topic = image_topic(log, self.topic)
        stream = BagStream(log, topic, self.stamps, self.looks, self.color, self.camera_info)
        if self.positions is None:
            camera_poses = CameraPoses(stream.frame, self.axes, self._looks_of(stream), self.world, self.poses)
            stream.poses = camera_poses.of(log, stream.remarks)
        return stream

    def _looks_of(self, stream: BagStream) -> str:
        """Where the camera looks: as set, or as its model does, or as panoramas do."""
        if self.looks is not None:
            return self.looks
        own = stream.camera if self.camera_choice.is_open else None
        front: Panorama | None = self.panorama
        return getattr(own, "looks", "ahead" if front else "down")


@dataclass
class Mcap(RosBag):
    """A topic of images in an MCAP log: of Foxglove's protobuf messages or of ROS, also `run.mcap` of omnilab itself.

    Images come back as they were logged, bit for bit: those of `run.mcap` as the JPEG that it holds decodes, those of
    `omnilab convert --mcap` as they were. Everything else is as of the sensor `rosbag`.
    """
