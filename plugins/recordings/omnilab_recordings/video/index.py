"""Index of a video: when each of its frames is shown and from where it can be decoded, found in one pass over the file."""

from __future__ import annotations

import hashlib
import re
from array import array
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omnilab.api import Bools, Ints
from omnilab.errors import DataError
from omnilab_recordings.images.decoding import MOST_PIXELS
from omnilab_recordings.video.container import open_file
from omnilab_recordings.video.decoding import Decoded, FrameDecoder, UnreadableError, is_idr, packets_of

if TYPE_CHECKING:
    from av import VideoFrame
    from av.container import InputContainer
    from av.packet import Packet
    from av.video.stream import VideoStream

MOST_FRAMES = 20_000_000  # four days at 60 a second
UNKNOWN = -(2**63)
UNORDERED = {"avi", "h264", "hevc", "m4v", "mpegvideo", "obu", "vc1", "vvc"}  # their times, if any, are of decoding
USUAL_RATE = Fraction(25)  # frames a second, where nothing says it
VARIES = 0.1  # of the usual time between frames
LATEST_S = 9e9  # of a time: nanoseconds in 64 bits
PROBED = 40  # packets by which a coding is judged
DAMAGE = re.compile(r"conceal|error while decoding|corrupt|missing|overread|truncat|CRC|invalid data", re.IGNORECASE)
EARLIEST_YEAR = 1990  # cameras without a clock say 1904 or 1970

Identity = tuple[int | None, bytes]  # when a packet is shown, and a digest of its data


def identity(packet: Packet[VideoStream]) -> Identity:
    """By which a packet is known again after a seek."""
    return packet.pts, hashlib.sha256(packet).digest()


@dataclass(frozen=True)
class Packets:
    """The P packets of a stream, in the order in which they are decoded."""

    pts: Ints  # (P,) when they are shown, in the stream's unit; UNKNOWN where the file does not say
    dts: Ints  # (P,) when they are decoded
    keys: Bools  # (P,) whether decoding can begin there
    shown: Bools  # (P,) whether they are for showing at all
    numbers: Mapping[Identity, int]  # of key frames that can be told from all others
    damage: str  # why the file could be read no farther; "": all of it could


@dataclass(frozen=True)
class VideoIndex:
    """N frames, in the order in which they are shown."""

    packets: Packets
    packet: Ints  # (N,) that each frame is of
    rank: Ints  # (P,) which frame each packet becomes; -1: none
    stamps_ns: Ints  # (N,) on the file's own clock, which mostly begins at 0
    size: tuple[int, int]  # width, height of a frame as stored
    rotation_deg: int  # by which frames are turned counter-clockwise to be upright
    strict: bool  # whether its coding is by the book, so that what is not is damage
    created_ns: int | None  # since 1970, where the file says when it was begun
    remarks: Mapping[str, str] = field(default_factory=dict)  # sentences by topic

    def __len__(self) -> int:
        return len(self.packet)

    def start(self, frame: int) -> int:
        """The packet from which on packets are decoded to get a frame: a key frame that is not shown after it."""
        for key in self.keys_before(int(self.packet[frame])):
            if self.rank[key] <= frame:
                return int(key)
        return 0

    def keys_before(self, packet: int) -> Ints:
        """The key frames' packets up to one, the nearest first."""
        return self._keys[: np.searchsorted(self._keys, packet, side="right")][::-1]

    @cached_property
    def _keys(self) -> Ints:
        return np.flatnonzero(self.packets.keys)


def index_of(path: Path, stream: int = 0) -> VideoIndex:
    """The index of a video file. All of it is read once, and again when it has changed.

    DataError where it has no frame that can be decoded, or times that are none.
    """
    try:
        found = path.stat()
    except OSError as error:
        raise DataError(f"the video {path} cannot be read ({error.strerror}); give sensor.path=FILE") from error
    return _index(path, stream, found.st_size, found.st_mtime_ns, found.st_ino)


@lru_cache(maxsize=16)
def _index(path: Path, stream: int, *_: int) -> VideoIndex:
    container, video = open_file(path, stream)
    with container:
        packets = _packets(container, video, path)
        created_ns, unit = _created_ns(container.metadata), video.time_base or Fraction(1, 1000)
        rate, aspect = video.average_rate or video.guessed_rate or USUAL_RATE, video.sample_aspect_ratio
        unordered = bool(set(container.format.name.split(",")) & UNORDERED)
    beginning, first = _beginning(path, stream)
    packet = _display_order(path, stream, packets, unordered or not beginning.ordered(packets), beginning.strict)
    known = np.sort(packets.pts[packet])
    timed = known[0] != UNKNOWN
    stamps_ns = _nanoseconds(known, unit, path) if timed else _nanoseconds(np.arange(len(known)), 1 / rate, path)
    rank = np.full(len(packets.pts), -1)
    rank[packet] = np.arange(len(packet))
    lost = int(packets.shown.sum()) - len(packet)
    remarks = _about_first(first, aspect) | {
        "coding": "" if beginning.strict else "its coding is not by the book: what is damaged in it cannot be told",
        "damage": packets.damage,
        "lost": f"{lost} of its {lost + len(packet)} frames cannot be decoded, and are not counted" if lost else "",
        "times": "" if timed else f"it holds no times: its frames are taken to be {1e3 / float(rate):.4g} ms apart",
        "varying": _varying(stamps_ns, unit) if timed else "",
    }
    rotation = first.rotation % 360 if first.rotation % 90 == 0 else 0
    warnings = {topic: sentence for topic, sentence in remarks.items() if sentence}
    return VideoIndex(
        packets, packet, rank, stamps_ns, (first.width, first.height), rotation, beginning.strict, created_ns, warnings
    )


def _about_first(first: VideoFrame, aspect: Fraction | None) -> dict[str, str]:
    """What a first frame tells of all, a sentence a topic, "" where there is nothing to be said."""
    turn = first.rotation
    return {
        "pixels": "" if aspect in {None, 0, 1} else f"its pixels are {aspect} as wide as high, and taken as they are",
        "interlaced": "its frames are two half pictures of different times each" if first.interlaced_frame else "",
        "rotation": f"it is to be shown turned by {turn} degrees, and is not" if turn % 90 else "",
    }


def _packets(container: InputContainer, video: VideoStream, path: Path) -> Packets:
    pts, dts, keys, shown = array("q"), array("q"), array("b"), array("b")
    numbers: dict[Identity, int] = {}
    avc, extradata = video.codec_context.name == "h264", video.codec_context.extradata or b""
    damage = ""
    try:
        for packet in packets_of(container, video):
            if len(pts) == MOST_FRAMES:
                raise DataError(f"{path} has more than {MOST_FRAMES} frames; cut it into several")
            if key := packet.is_keyframe and (not avc or is_idr(packet, extradata)):
                name = identity(packet)
                numbers[name] = -1 if name in numbers else len(pts)
            pts.append(UNKNOWN if packet.pts is None else packet.pts)
            dts.append(UNKNOWN if packet.dts is None else packet.dts)
            keys.append(key)
            shown.append(not packet.is_discard)
    except UnreadableError as error:
        damage = f"the file cannot be read after its packet {len(pts)} ({error}): what comes before is used"
    if not any(shown):
        raise DataError(f"{path} has a video stream without a single frame; give another file")
    told_apart = {name: number for name, number in numbers.items() if number >= 0}
    return Packets(np.array(pts), np.array(dts), np.array(keys, bool), np.array(shown, bool), told_apart, damage)


def _display_order(path: Path, stream: int, packets: Packets, unordered: bool, strict: bool) -> Ints:
    """The packets (N,) of the frames that are shown, in that order: by their times or, without these, by decoding all."""
    shown = np.flatnonzero(packets.shown)
    unordered |= bool((packets.pts[shown] == UNKNOWN).any())
    if not unordered:
        return shown[np.argsort(packets.pts[shown], kind="stable")]
    if packets.keys.all():
        return shown
    decoded = np.array([found.packet for found in _decoded(path, stream, strict) if found], np.int64)
    return np.asarray(decoded[packets.shown[decoded]])


@dataclass(frozen=True)
class _Beginning:
    """The first packets of a file, decoded."""

    first: VideoFrame | None  # None: none decodes
    order: list[int]  # the packets of the frames, in the order in which the decoder shows them
    errors: int  # packets that do not decode
    strict: bool

    def ordered(self, packets: Packets) -> bool:
        """Whether frames are shown in the order of their times."""
        return bool((np.diff(packets.pts[self.order]) >= 0).all())


def _beginning(path: Path, stream: int) -> tuple[_Beginning, VideoFrame]:
    """Strictly, unless what is not by the book is nothing that damage is reported as; DataError if nothing decodes."""
    import av

    found = _begun(path, stream, strict=True)
    if found.errors or found.first is None:
        level = av.logging.get_level()
        av.logging.set_level(av.logging.ERROR)
        try:
            with av.logging.Capture() as messages:
                lenient = _begun(path, stream, strict=False)
        finally:
            av.logging.set_level(level)
        if found.first is None or not any(DAMAGE.search(text) for _, _, text in messages):
            found = lenient
    if found.first is None:
        raise DataError(
            f"{path} has no frame that can be decoded: it is damaged, larger than {MOST_PIXELS // 10**6} million pixels, or coded"
            " in a way that is not known here"
        )
    return found, found.first


def _begun(path: Path, stream: int, strict: bool) -> _Beginning:
    first, order, errors = None, list[int](), 0
    for found in _decoded(path, stream, strict, PROBED):
        if found is None:
            errors += 1
        else:
            first = first or found.frame
            order.append(found.packet)
    return _Beginning(first, order, errors, strict)


def _decoded(path: Path, stream: int, strict: bool, most: int | None = None) -> Iterator[Decoded | None]:
    """The frames of the first packets of a file in the order in which they are shown; None for what does not decode."""
    container, video = open_file(path, stream, strict)
    decoder, errors = FrameDecoder(video.codec_context), 0
    with container, suppress(UnreadableError):
        for number, packet in enumerate(islice(packets_of(container, video), most)):
            yield from decoder.feed(packet, number, packet.is_keyframe)
            yield from [None] * (decoder.errors - errors)
            errors = decoder.errors
        yield from decoder.drain()


def _nanoseconds(times: Ints, unit: Fraction, path: Path) -> Ints:
    """Times in a unit as whole nanoseconds; DataError for those that are no times."""
    if (np.abs(times.astype(float)) * float(unit) > LATEST_S).any():
        raise DataError(
            f"{path} has a frame at {float(times.max() * unit):.3g} s, which is no time; its header is damaged"
        )
    seconds, rest = np.divmod(times * unit.numerator, unit.denominator)
    return np.asarray(seconds * 10**9 + (rest * 10**9 + unit.denominator // 2) // unit.denominator, np.int64)


def _varying(stamps_ns: Ints, unit: Fraction) -> str:
    """Whether frames come at uneven times."""
    steps_ms = np.diff(stamps_ns) / 1e6
    if not len(steps_ms):
        return ""
    usual = float(np.median(steps_ms))
    if np.abs(steps_ms - usual).max() <= VARIES * usual + 2e3 * float(unit):
        return ""
    return (
        f"its frames are {steps_ms.min():.4g} to {steps_ms.max():.4g} ms apart, mostly {usual:.4g}: their times are those of"
        " the file"
    )


def _created_ns(metadata: Mapping[str, str]) -> int | None:
    """When a video was begun, in whole seconds mostly, as its metadata say."""
    for name in ("com.apple.quicktime.creationdate", "creation_time", "DATE"):
        try:
            when = datetime.fromisoformat(metadata.get(name, ""))
        except ValueError:
            continue
        utc = when.replace(tzinfo=UTC) if when.tzinfo is None else when
        if utc.year >= EARLIEST_YEAR:
            return int(utc.timestamp()) * 10**9 + utc.microsecond * 1000
    return None
