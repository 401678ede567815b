"""Packets of a video to frames, each known by the number of its packet; damaged ones are told, not guessed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from av import VideoFrame
    from av.container import InputContainer
    from av.packet import Packet
    from av.video.codeccontext import VideoCodecContext
    from av.video.stream import VideoStream


IDR = 5  # the kind of a NAL unit


class UnreadableError(Exception):
    """A file that can be read no farther, in a few words."""


class Decoded(NamedTuple):
    """A frame as it comes out of the decoder, in the order in which frames are shown."""

    packet: int  # its number in the order of decoding
    frame: VideoFrame
    doubt: str  # why it may not be the picture that was taken; "": nothing is wrong


def packets_of(container: InputContainer, video: VideoStream) -> Iterator[Packet[VideoStream]]:
    """The packets of a stream that hold data; UnreadableError where the file can be read no farther."""
    import av

    try:
        yield from (packet for packet in container.demux(video) if packet.size)
    except av.error.FFmpegError as error:
        raise UnreadableError(error.strerror) from error
    except IndexError as error:  # PyAV knows those streams that were there when the file was opened
        raise UnreadableError("another stream begins there") from error


def is_idr(packet: Packet[VideoStream], extradata: bytes) -> bool:
    """Whether nothing after an H.264 key frame refers to what was before it: else decoding cannot begin there.

    Containers count others as key frames, too: recovery points, which open groups of pictures have.
    """
    data, at = bytes(packet), 0
    if extradata[:1] != b"\1":  # start codes
        return any(data[i + 3] & 31 == IDR for i in _starts(data) if i + 3 < len(data))
    size = (extradata[4] & 3) + 1 if len(extradata) > 4 else 4
    while at + size < len(data):
        if data[at + size] & 31 == IDR:
            return True
        at += size + int.from_bytes(data[at : at + size])
    return False


def _starts(data: bytes) -> Iterator[int]:
    at = data.find(b"\0\0\1")
    while at >= 0:
        yield at
        at = data.find(b"\0\0\1", at + 3)


class FrameDecoder:
    """Decodes packets one after another, from a key frame on.

    After a packet that cannot be decoded, frames refer to a picture that is not there: all up to the next key frame are
    doubtful. Frames that are decoded after the key frame at which decoding begins, or begins anew after damage, and shown
    before it, refer to what was not decoded: they are left out.
    """

    def __init__(self, context: VideoCodecContext) -> None:
        self._context = context
        self._first_rank = -1  # of the key frame where decoding began
        self._damaged: int | None = None  # the packet from which on frames are doubtful
        self.errors = 0

    def begin(self, rank: int) -> None:
        """The next packet is a key frame, shown in that place: what was decoded before is forgotten."""
        self._context.flush_buffers()
        self._first_rank, self._damaged = rank, None

    def feed(self, packet: Packet[VideoStream], number: int, key: bool, rank: int = -1) -> Iterator[Decoded]:
        """Decode one packet, which is shown in that place (-1: not known): the frames that are now complete."""
        import av

        if key and self._damaged is not None:
            yield from self.drain()
            self.begin(rank)
        packet.opaque = [number]  # PyAV knows it by its identity: a number is one object wherever it is used
        try:
            frames = self._context.decode(packet)
        except av.error.FFmpegError:
            if 0 <= rank < self._first_rank:  # as is to be expected
                return
            self.errors += 1
            self._damaged = number if self._damaged is None else self._damaged
            return
        yield from self._judged(frames)

    def drain(self) -> Iterator[Decoded]:
        """The frames that were waiting for others."""
        import av

        with suppress(av.error.FFmpegError):  # what lacks is found to be lacking
            yield from self._judged(self._context.decode(None))

    def _judged(self, frames: Iterable[VideoFrame]) -> Iterator[Decoded]:
        for frame in frames:
            if not isinstance(frame.opaque, list):  # made up by the decoder, in place of what it has not
                continue
            number = int(frame.opaque[0])
            doubtful = self._damaged is not None and number >= self._damaged
            doubt = "refers to damaged data before it" if doubtful else "is marked as damaged"
            yield Decoded(number, frame, doubt if doubtful or frame.is_corrupt else "")
