"""Video files and streams opened: which formats and protocols may be, and within which bounds."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from omnilab.errors import ConfigError, DataError
from omnilab.file_kinds import opened
from omnilab_recordings.images.decoding import MOST_PIXELS

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.codeccontext import VideoCodecContext
    from av.video.stream import VideoStream

LARGEST_FILE = 2**42  # bytes
FORMATS = {  # that hold their pictures themselves; playlists, which lead to other files and addresses, are not among them
    "apng", "asf", "av1", "avi", "dirac", "dv", "flv", "gif", "h261", "h263", "h264", "hevc", "ivf", "m4v",
    "matroska", "mjpeg", "mov", "mpeg", "mpegts", "mpegvideo", "mpjpeg", "mxf", "nut", "obu", "ogg", "rm", "swf",
    "vc1", "vvc", "webm", "wtv", "yuv4mpegpipe",
}  # fmt: skip
STRICT, LENIENT = "crccheck+explode", "crccheck"  # damaged data are an error, or the decoder's guess at what they were


def open_file(path: Path, stream: int = 0, strict: bool = True) -> tuple[InputContainer, VideoStream]:
    """A video file and one of its video streams; DataError in one sentence where there is none."""
    import av

    try:
        opened(path, LARGEST_FILE).close()
    except OSError as error:
        raise DataError(f"the video {path} cannot be read ({error.strerror}); give sensor.path=FILE") from error
    name = f"file:{os.path.abspath(path)}"  # noqa: PTH100  links stay, and no name is an address
    try:
        container = av.open(name, options=options("file"), metadata_errors="replace")
    except av.error.FFmpegError as error:
        raise DataError(
            f"{path} is no video that is read, or its header is damaged ({error.strerror}); give a file with a video stream,"
            " such as .mp4, .mkv or .avi"
        ) from error
    try:
        return container, video_stream(container, str(path), stream, strict)
    except Exception:
        container.close()
        raise


def options(protocols: str) -> dict[str, str]:
    """What FFmpeg may open, and how large a picture may be."""
    import av

    known = [name for name in av.formats_available if FORMATS & set(name.split(","))]
    formats = {one for name in known for one in name.split(",")} | {"mov", "mp4", "rtsp", "v4l2", "video4linux2"}
    return {
        "protocol_whitelist": protocols,
        "format_whitelist": ",".join(sorted(formats)),
        "max_pixels": str(MOST_PIXELS),
    }


def video_stream(container: InputContainer, name: str, number: int = 0, strict: bool = True) -> VideoStream:
    """One of a container's video streams, ready to be decoded; DataError where it has none, or one of no or too large a size."""
    from av.stream import Discard

    found = [stream for stream in container.streams.video if not _is_cover(stream)]
    if not found:
        kinds = sorted({stream.type for stream in container.streams})
        raise DataError(f"{name} has no video stream (but {', '.join(kinds) or 'nothing'}); give a file that has one")
    if number >= len(found):
        raise ConfigError(
            f"stream={number} is not in {name}, which has {len(found)}, counted from 0; give a smaller one"
        )
    stream = found[number]
    context: VideoCodecContext | None = stream.codec_context
    if context is None:
        raise DataError(f"{name} is coded in a way that is not known here; convert it, to H.264 say")
    width, height = context.width, context.height
    if width * height > MOST_PIXELS:
        raise DataError(
            f"{name} is {width} x {height} pixels, more than the {MOST_PIXELS // 10**6} million that are read (scale it down)"
        )
    context.thread_count = 1  # several decode damaged data in another way each time
    context.copy_opaque = True
    context.options = {"err_detect": STRICT if strict else LENIENT, "max_pixels": str(MOST_PIXELS)}
    for other in container.streams:
        if other.index != stream.index:
            other.discard = Discard.all  # its data are not even read
    return stream


def _is_cover(stream: VideoStream) -> bool:
    """Whether a video stream is but a picture of its album or a thumbnail."""
    return bool(stream.disposition & stream.disposition.__class__["attached_pic"])
