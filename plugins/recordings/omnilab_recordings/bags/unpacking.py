"""Packed chunks of logs, unpacked within bounds."""

from __future__ import annotations

import bz2

from omnilab_recordings.bags.message import LARGEST_BYTES, Damaged


def unpacked(data: memoryview, packed_by: str, size: int) -> memoryview:
    """The content of a chunk that says to hold `size` bytes; Damaged if it is not that, or more than are held in memory."""
    if size > LARGEST_BYTES:
        raise Damaged(f"a chunk of {size} bytes, more than the {LARGEST_BYTES} that are held in memory")
    try:
        content = _content(data, packed_by, size)
    except (RuntimeError, OSError, ValueError, EOFError) as error:
        raise Damaged(f"a chunk that cannot be unpacked ({packed_by})") from error
    if len(content) != size:
        raise Damaged(f"a chunk that unpacks to another size than it says ({packed_by})")
    return memoryview(content)


def _content(data: memoryview, packed_by: str, size: int) -> bytes | memoryview:
    if packed_by in {"", "none"}:
        return data
    if packed_by == "bz2":
        return bz2.BZ2Decompressor().decompress(data, size + 1)
    if packed_by == "lz4":
        import lz4.frame

        content: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data, size + 1)
        return content
    if packed_by == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor(max_window_size=2**27).stream_reader(bytes(data)) as stream:
            return bytes(stream.read(size + 1))
    raise Damaged(f"a chunk packed by {packed_by[:20]!r}, which is not known here")
