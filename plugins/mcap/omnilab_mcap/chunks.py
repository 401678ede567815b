"""Chunks of an MCAP log, opened within bounds and held against their checksum."""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from io import BytesIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, McapRecord, Message, Schema

from omnilab import log_files
from omnilab.errors import DataError

HEAD = struct.Struct("<BQ")  # opcode and length of every record
CHUNK = struct.Struct("<QQQII")  # first and last log time, size and checksum of the content, length of the codec's name
MESSAGE_BYTES = 22  # of a message without its data
LARGEST_BYTES = 256 << 20  # of a record, and of what a chunk unpacks to: held in memory
CODECS = {b"", b"zstd", b"lz4"}
PACKED_STARTS = {b"\x28\xb5\x2f\xfd", b"\x04\x22\x4d\x18"}  # of data packed by zstd and by lz4, whatever the name says
Index = dict[int, list[tuple[int, int]]]  # by channel, log time and offset of each message of a chunk


class UnreadableRecord(log_files.Unreadable):
    """A record is not whole, and `messages`: it may have held some."""

    def __init__(self, what: str, torn: bool = False, messages: bool = True) -> None:
        super().__init__(what, torn)
        self.messages = messages


def is_chunk(start: bytes, length: int) -> bool:
    """Whether the first bytes of a record are those of a chunk of `length` bytes, head included."""
    try:
        _, _, codec, data = _parts(start, length)
    except UnreadableRecord:
        return False
    return codec in CODECS and data < length


def times(raw: bytes) -> tuple[int, int]:
    """The log times of a chunk's first and last message, ns, as its head tells them."""
    first, last, *_ = CHUNK.unpack_from(raw, HEAD.size)
    return first, last


def opened(raw: bytes, name: str) -> tuple[list[McapRecord], Index]:
    """A chunk's records, and what the message indexes behind it should hold.

    UnreadableRecord if it is not whole, DataError if it would not fit into memory or is packed in a way unknown here.
    """
    size, crc, codec, start = _parts(raw, len(raw))
    data = memoryview(raw)[start:]
    if codec not in CODECS:
        if codec.isalnum() and bytes(data[:4]) not in PACKED_STARTS:
            raise DataError(
                f"{name} has a chunk that is packed by '{codec.decode()}', which is unknown here; it cannot be checked and is"
                " as it was"
            )
        raise UnreadableRecord("a chunk whose codec is unknown")
    if size > LARGEST_BYTES and _says_itself(data, codec) == size:
        raise DataError(
            f"{name} has a chunk that unpacks to {size} bytes, and up to {LARGEST_BYTES} are held in memory; it cannot be"
            " checked here and is as it was"
        )
    content = _unpacked(data, codec, size)
    if len(content) != size or crc not in {0, zlib.crc32(content)}:
        raise UnreadableRecord("a chunk that fails its checksum")
    return _records(content)


def parsed(kind: type[McapRecord], raw: bytes) -> McapRecord:
    """A record other than a chunk or a message; UnreadableRecord if it is not what would be written of what it holds."""
    try:
        record = kind.read(ReadDataStream(BytesIO(raw[HEAD.size :])))
        content = written(record)
    except (McapError, struct.error, ValueError, OverflowError) as error:
        raise UnreadableRecord(f"a broken {kind.__name__}", messages=False) from error
    if kind is Attachment and raw[-4:] == bytes(4):  # its writer computed no checksum
        content = content[:-4] + bytes(4)
    if raw[HEAD.size : len(content)] != content[HEAD.size :]:  # longer ones may come with later versions of the format
        raise UnreadableRecord(f"a broken {kind.__name__}", messages=False)
    return record


def written(record: McapRecord) -> bytes:
    """The bytes of a record, head included."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def message(raw: bytes) -> Message:
    """A message from its bytes, head included."""
    if len(raw) < HEAD.size + MESSAGE_BYTES:
        raise UnreadableRecord("a broken Message")
    return Message.read(ReadDataStream(BytesIO(raw[HEAD.size :])), len(raw) - HEAD.size)


def _parts(start: bytes, length: int) -> tuple[int, int, bytes, int]:
    """Size and checksum of a chunk's content, the name of its codec, and where its data start."""
    if len(start) < HEAD.size + CHUNK.size:
        raise UnreadableRecord("a chunk without content")
    _, _, size, crc, named = CHUNK.unpack_from(start, HEAD.size)
    codec_at = HEAD.size + CHUNK.size
    data_at = codec_at + named + 8
    if len(start) < data_at:
        raise UnreadableRecord("a chunk whose lengths disagree")
    codec, (data,) = bytes(start[codec_at : codec_at + named]), struct.unpack_from("<Q", start, codec_at + named)
    if data_at + data != length:
        raise UnreadableRecord("a chunk whose lengths disagree")
    return size, crc, codec, data_at


def _says_itself(data: memoryview, codec: bytes) -> int:
    """The size to which packed data say that they unpack, -1 if they do not."""
    if codec == b"zstd":
        try:
            return int(zstandard.frame_content_size(data))
        except zstandard.ZstdError as error:
            raise UnreadableRecord("a chunk that fails its checksum") from error
    return len(data) if codec == b"" else -1


def _unpacked(data: memoryview, codec: bytes, size: int) -> bytes | memoryview:
    """The content; never much more than `size` bytes."""
    if codec == b"":
        return data
    if size > LARGEST_BYTES or _says_itself(data, codec) not in {-1, size}:
        raise UnreadableRecord("a chunk that unpacks to another size than it says")
    try:
        if codec == b"zstd":
            with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as reader:
                return bytes(reader.read(size + 1))
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise UnreadableRecord("a chunk that fails its checksum") from error


def _records(content: bytes | memoryview) -> tuple[list[McapRecord], Index]:
    records, index, at = list[McapRecord](), defaultdict[int, list[tuple[int, int]]](list), 0
    while at < len(content):
        opcode, length = HEAD.unpack_from(content, at) if at + HEAD.size <= len(content) else (0, 0)
        end = at + HEAD.size + length
        if not opcode or end > len(content):
            raise UnreadableRecord("a chunk whose content is torn")
        raw = bytes(content[at:end])
        match opcode:
            case Opcode.SCHEMA:
                records.append(parsed(Schema, raw))
            case Opcode.CHANNEL:
                records.append(parsed(Channel, raw))
            case Opcode.MESSAGE:
                records.append(found := message(raw))
                index[found.channel_id].append((found.log_time, at))
        at = end
    return records, index
