"""What a log holds: gone through once, so that each image can be read again by itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from omnilab.api import Ints
from omnilab.errors import DataError
from omnilab.file_kinds import kind_of_file
from omnilab_recordings.bags.decoding import (
    CALIBRATIONS,
    IMAGES,
    POSES,
    TRANSFORMS,
    CalibrationMessage,
    ImageMessage,
    TransformMessage,
    decoded_calibration,
    decoded_image,
    decoded_transforms,
    is_read,
    kind_of,
)
from omnilab_recordings.bags.mcap_file import McapFile
from omnilab_recordings.bags.message import LogFile, LogMessage, Place
from omnilab_recordings.bags.ros1_file import Ros1File
from omnilab_recordings.bags.sqlite_file import SqliteFile
from omnilab_recordings.images.order import in_order

MOST_TRANSFORMS = 5_000_000  # of a log, held in memory
KINDS = "a bag of ROS 1 (.bag), a bag of ROS 2 (its folder, .db3 or .mcap) or an MCAP log"


@dataclass
class ImageTopic:
    """The images of a topic, in the order in which they were recorded."""

    kind: str
    encoding: str  # of its messages
    first: ImageMessage  # without its data
    record_ns: list[int] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)  # of the headers
    places: list[tuple[int, Place]] = field(default_factory=list)  # file, and where in it

    def in_time(self) -> tuple[Ints, Ints, list[tuple[int, Place]]]:
        """Record times (N,), header times (N,) and places, sorted by the first."""
        order = np.argsort(self.record_ns, kind="stable")
        record, stamps = np.array(self.record_ns, np.int64), np.array(self.stamps_ns, np.int64)
        return record[order], stamps[order], [self.places[i] for i in order.tolist()]


class LogIndex:
    """The topics of a log, its images by place, and its calibrations and transforms as a whole."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = [_opened(file) for file in _files(path)]
        self.topics: dict[str, str] = {}  # and their kinds
        self.counts: Counter[str] = Counter()
        self.images: dict[str, ImageTopic] = {}
        self.calibrations: dict[str, CalibrationMessage] = {}
        self.transforms: dict[str, list[TransformMessage]] = {}
        self.attachments: dict[str, bytes] = {}
        self.unread: Counter[str] = Counter()  # messages of topics that could not be decoded
        self._held = 0
        for number, file in enumerate(self.files):
            for message in file.messages():
                self._add(number, message)
            self.attachments |= file.attachments()
            file.close()

    @property
    def damage(self) -> str | None:
        """What is wrong with the files; None if they are whole."""
        found = [file.damage for file in self.files if file.damage]
        return found[0] if found else None

    def message(self, topic: str, number: int, place: Place) -> LogMessage:
        """An image's message again."""
        image = self.images[topic]
        return LogMessage(topic, image.kind, image.encoding, 0, self.files[number].read(place), place)

    def listed(self) -> str:
        """The topics with type and number of messages, for a sentence."""
        shown = [f"{topic} ({kind}, {self.counts[topic]})" for topic, kind in sorted(self.topics.items())]
        return ", ".join(shown[:20]) + (", ..." if len(shown) > 20 else "")

    def close(self) -> None:
        """Until an image is read again."""
        for file in self.files:
            file.close()

    def _add(self, number: int, message: LogMessage) -> None:
        topic = message.topic
        self.topics.setdefault(topic, kind_of(message))
        self.counts[topic] += 1
        try:
            if is_read(IMAGES, message):
                self._add_image(number, message)
            elif is_read(CALIBRATIONS, message) and topic not in self.calibrations:
                self.calibrations[topic] = decoded_calibration(message)
            elif is_read(TRANSFORMS | POSES, message) and (found := decoded_transforms(message)):
                self.transforms.setdefault(topic, []).extend(found)
                self._held += len(found)
        except DataError:
            self.unread[topic] += 1
        if self._held > MOST_TRANSFORMS:
            raise DataError(f"{self.path} holds more than {MOST_TRANSFORMS} poses; split it")

    def _add_image(self, number: int, message: LogMessage) -> None:
        image = decoded_image(message)
        first = replace(image, data=memoryview(b""))
        known = self.images.setdefault(message.topic, ImageTopic(message.kind, message.encoding, first))
        if (known.kind, known.encoding) != (message.kind, message.encoding):
            raise DataError("is of another kind than the others of its topic")
        known.record_ns.append(message.record_ns)
        known.stamps_ns.append(image.stamp_ns)
        known.places.append((number, message.place))


def _files(path: Path) -> Iterator[Path]:
    """The files of a log, in their order."""
    if not path.is_dir():
        yield path
        return
    for suffix in (".mcap", ".db3", ".bag"):
        if names := in_order(
            file.name for file in path.iterdir() if file.suffix == suffix and not file.name.startswith(".")
        ):
            yield from (path / name for name in names)
            return
    packed = next((file.name for file in sorted(path.iterdir()) if file.suffix in {".zstd", ".zst"}), None)
    remedy = f"unpack {packed} first: zstd -d {path / packed}" if packed else f"give {KINDS}, sensor.path=FILE"
    raise DataError(f"the folder {path} holds no .db3, .mcap or .bag; {remedy}")


def _opened(file: Path) -> LogFile:
    """A file of a log; DataError that says what else it is."""
    try:
        kind = kind_of_file(file)
    except OSError as error:
        raise DataError(f"{file} cannot be read ({error.strerror or error}); give {KINDS}, sensor.path=FILE") from None
    if kind not in READERS:
        raise DataError(f"{file} is {kind or 'a text'}, no log; give {KINDS}, sensor.path=FILE")
    return READERS[kind](file)


READERS: Mapping[str | None, Callable[[Path], LogFile]] = {
    "an MCAP log": McapFile,
    "a ROS 1 bag": Ros1File,
    "an SQLite database (a ROS 2 bag, say)": SqliteFile,
}
