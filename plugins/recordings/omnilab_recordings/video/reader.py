"""Frames of a video by their numbers, exact to the bit wherever decoding begins."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from omnilab.api import Bytes
from omnilab_recordings.streams.image_stream import image_name
from omnilab_recordings.video.container import open_file
from omnilab_recordings.video.decoding import Decoded, FrameDecoder, UnreadableError, packets_of
from omnilab_recordings.video.index import UNKNOWN, VideoIndex, identity
from omnilab_recordings.video.pixels import LumaRange, image_of, turned

if TYPE_CHECKING:
    from av.packet import Packet
    from av.video.stream import VideoStream

NEAR = 24  # packets that are decoded rather than skipped
TRIES = 4  # key frames that are sought, each before the other, until the file is read from its beginning


@dataclass(frozen=True)
class FrameReader:
    """How frames of a video file become pixels."""

    path: Path
    index: VideoIndex
    stream: int = 0
    color: bool = False
    upright: bool = True  # turned as the file says
    range: LumaRange = LumaRange.auto

    def pictures(self, frames: Iterable[int]) -> Iterator[Bytes | str]:
        """The frames of some numbers, or why they are left out, best in ascending order.

        Decoding goes on where the next one is near, and begins anew at the key frame before it where that saves any.
        """
        runs = _Runs(self)
        try:
            for frame in frames:
                yield self._picture(frame, runs.find(frame))
        finally:
            runs.close()

    def _picture(self, frame: int, found: Decoded | None) -> Bytes | str:
        where = f"{image_name(self.path.name, frame)}, at {self.index.stamps_ns[frame] / 1e9:.3f} s,"
        if found is None:
            return f"{where} is damaged: nothing can be decoded"
        if found.doubt:
            return f"{where} {found.doubt}"
        size = found.frame.width, found.frame.height
        if size != self.index.size:
            return f"{where} is {size[0]} x {size[1]} pixels, the video {self.index.size[0]} x {self.index.size[1]}"
        image = image_of(found.frame, self.color, self.range)
        return turned(image, self.index.rotation_deg) if self.upright else image


class _Runs:
    """Decoding that moves on, or begins anew, as frames are looked for."""

    def __init__(self, reader: FrameReader) -> None:
        self._reader, self._index = reader, reader.index
        self._frames: Iterator[Decoded] = iter(())
        self._later: Decoded | None = None  # was decoded, and is shown after what was looked for
        self._fed, self._last = -1, -1  # the last packet that was decoded; the last frame that was looked for
        self._open()

    def _open(self) -> None:
        self._container, self._video = open_file(self._reader.path, self._reader.stream, self._index.strict)
        self._decoder = FrameDecoder(self._video.codec_context)

    def close(self) -> None:
        self._container.close()

    def find(self, frame: int) -> Decoded | None:
        """A frame; None if decoding passes it by."""
        start = self._index.start(frame)
        if self._last < 0 or frame <= self._last or start > self._fed + NEAR:
            self._frames, self._later = self._from(start), None
        self._last = frame
        while (found := self._later or next(self._frames, None)) is not None:
            rank = int(self._index.rank[found.packet])
            self._later = found if rank > frame else None
            if rank >= frame:
                return found if rank == frame else None
        return None

    def _from(self, start: int) -> Iterator[Decoded]:
        """The frames from a key frame's packet on, as far as the file can be read."""
        keys, rank = self._index.packets.keys, self._index.rank
        with suppress(UnreadableError):
            for number, packet in self._packets(start):
                if number == start:
                    self._decoder.begin(int(rank[start]))
                self._fed = number
                yield from self._decoder.feed(packet, number, bool(keys[number]), int(rank[number]))
        yield from self._decoder.drain()

    def _packets(self, start: int) -> Iterator[tuple[int, Packet[VideoStream]]]:
        """Packets with their numbers from `start` on: sought where the file can be, or read from its beginning."""
        for key in self._index.keys_before(start)[:TRIES]:
            found = self._sought(int(key))
            first = next((one for one in found if one[0] >= start), None)
            if first is not None and first[0] == start:
                yield from chain([first], found)
                return
        self.close()
        self._open()
        for number, packet in enumerate(packets_of(self._container, self._video)):
            if start <= number < len(self._index.rank):
                yield number, packet

    def _sought(self, key: int) -> Iterator[tuple[int, Packet[VideoStream]]]:
        """Packets from about a key frame on, each known by where it lies and what it says of itself."""
        import av

        packets = self._index.packets
        at = packets.dts[key] if packets.dts[key] != UNKNOWN else packets.pts[key]
        if at == UNKNOWN or not key:
            return
        try:
            self._container.seek(int(at), stream=self._video)
        except av.error.FFmpegError:
            return
        number = -1
        for packet in packets_of(self._container, self._video):
            number += number >= 0
            if packet.is_keyframe:
                number = packets.numbers.get(identity(packet), number)
            if 0 <= number < len(packets.pts):
                yield number, packet
