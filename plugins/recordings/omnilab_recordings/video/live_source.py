"""Frames as they come: from a device, an address, or a file that is played at its own pace; each with when it arrived."""

from __future__ import annotations

import ipaddress
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

from omnilab.errors import ConfigError, DataError
from omnilab_recordings.video.container import open_file, options, video_stream
from omnilab_recordings.video.decoding import FrameDecoder, UnreadableError, packets_of

if TYPE_CHECKING:
    from av import VideoFrame
    from av.container import InputContainer
    from av.video.stream import VideoStream

PROTOCOLS = {  # by which an address is opened, and no other
    "http": "http,tcp", "https": "https,tls,tcp", "rtsp": "rtsp,rtp,udp,tcp", "rtmp": "rtmp,tcp", "tcp": "tcp", "udp": "udp",
}  # fmt: skip
Opened = tuple["InputContainer", "VideoStream"]


class LiveFrame(NamedTuple):
    """A frame, and when it arrived on this machine's clock, in nanoseconds since 1970."""

    frame: VideoFrame
    stamp_ns: int


@dataclass(frozen=True)
class LiveAddress:
    """Where frames come from: a number or /dev/videoN, an address, or a file."""

    path: str
    allow_network: bool = False
    silence_s: float = 5.0  # after which nothing is expected any more
    rate: float | None = None  # of a device
    size_px: tuple[int, int] | None = None  # of a device: width, height

    def __post_init__(self) -> None:
        if self.scheme is not None:
            self._check_address()

    @property
    def scheme(self) -> str | None:
        """Of an address; None of a device or a file."""
        return urlsplit(self.path).scheme.lower() if "://" in self.path else None

    @property
    def name(self) -> str:
        """As sentences have it: without the password that an address may hold."""
        if self.scheme is None:
            return self.device or Path(self.path).name
        parts = urlsplit(self.path)
        return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"

    @property
    def device(self) -> str | None:
        """The device's path; None where it is none."""
        if self.path.isascii() and self.path.isdigit():
            return f"/dev/video{self.path}"
        return self.path if self.path.startswith("/dev/") else None

    @property
    def is_file(self) -> bool:
        return self.scheme is None and self.device is None

    def open(self) -> Opened:
        """The container and its video stream; DataError, in a sentence, where there is none."""
        import av

        if self.is_file:
            return open_file(Path(self.path))
        name, format_, chosen = self.path, None, options(PROTOCOLS.get(self.scheme or "", "file"))
        if (device := self.device) is not None:
            self._check_device(device)
            name, format_ = device, "v4l2"
            chosen |= {} if self.rate is None else {"framerate": f"{self.rate:g}"}
            chosen |= {} if self.size_px is None else {"video_size": "{}x{}".format(*self.size_px)}
        elif self.scheme in {"http", "https"}:
            chosen |= {"max_redirects": "0"}  # no address leads to another one
        chosen |= {"fflags": "nobuffer"}
        try:
            container = av.open(name, format=format_, options=chosen, timeout=self.silence_s, metadata_errors="replace")
        except (av.error.FFmpegError, OSError) as error:
            raise DataError(
                f"{self.name} cannot be opened ({error.strerror}); see that it is there and that no other program uses it"
            ) from error
        try:
            return container, video_stream(container, self.name)
        except Exception:
            container.close()
            raise

    def _check_address(self) -> None:
        if self.scheme not in PROTOCOLS:
            raise ConfigError(
                f"path={self.name} is an address of a kind that is not opened; give one of {', '.join(PROTOCOLS)}, a device's"
                " number, or a file"
            )
        host = urlsplit(self.path).hostname or ""
        if not self.allow_network and not _is_loopback(host):
            raise ConfigError(
                f"{self.name} is not on this machine (127.0.0.1, ::1, localhost); give sensor.allow_network=true if it is meant"
            )

    def _check_device(self, device: str) -> None:
        if not Path(device).is_char_device():
            there = ", ".join(sorted(map(str, Path("/dev").glob("video*")))) or "none"
            raise DataError(f"there is no camera {device} (there is: {there}); plug it in, or give sensor.path=NUMBER")


def _is_loopback(host: str) -> bool:
    try:
        return host.lower() == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class LiveFrames:
    """The newest frames of a source, which a thread of its own decodes as they come; the oldest of too many is dropped."""

    def __init__(self, address: LiveAddress, buffer: int) -> None:
        self._address, self._held = address, deque[LiveFrame](maxlen=buffer)
        self._turn = threading.Condition()
        self._error: BaseException | None = None
        self._opened = self._over = False
        self.ended = ""  # why there are no more, in a few words
        self.dropped = 0
        threading.Thread(target=self._capture, name="omnilab-camera", daemon=True).start()

    def take(self) -> Iterator[LiveFrame]:
        """Frames as they come, until there are no more: `ended` says why. What opening raises is raised here."""
        while True:
            with self._turn:
                self._turn.wait_for(lambda: self._opened or self._over)  # opening has a limit of its own
                heard = self._turn.wait_for(lambda: self._held or self._over, self._address.silence_s)
                if self._error is not None:
                    raise self._error
                if not self._held:
                    self.ended = self.ended if heard else f"silent for {self._address.silence_s:g} s"
                    return
                found = self._held.popleft()
            yield found

    def close(self) -> None:
        """No more frames are wanted."""
        with self._turn:
            self._over = True
            self._turn.notify_all()

    def _capture(self) -> None:
        try:
            container, video = self._address.open()
            with self._turn:
                self._opened = True
                self._turn.notify_all()
            with container:
                self.ended = self._decode(container, video)
        except BaseException as error:  # noqa: BLE001  it belongs to the thread that takes
            self._error = error
        finally:
            self.close()

    def _decode(self, container: InputContainer, video: VideoStream) -> str:
        """Decode and hold frames; why it ended."""
        decoder = FrameDecoder(video.codec_context)
        due = _due_times() if self._address.is_file else None
        try:
            for number, packet in enumerate(packets_of(container, video)):
                for decoded in decoder.feed(packet, number, packet.is_keyframe):
                    if not decoded.doubt and not self._hold(decoded.frame, due):
                        return ""
        except UnreadableError as error:
            return f"{error}: was it unplugged?"
        for decoded in decoder.drain():
            if not decoded.doubt and not self._hold(decoded.frame, due):
                return ""
        return "its end was reached"

    def _hold(self, frame: VideoFrame, due: Callable[[float], float] | None) -> bool:
        """Hold a frame now, or when it is due; whether more are wanted."""
        with self._turn:
            if due is not None:
                self._turn.wait_for(lambda: self._over, max(due(frame.time or 0.0) - time.monotonic(), 0.0))
            if self._over:
                return False
            self.dropped += len(self._held) == self._held.maxlen
            self._held.append(LiveFrame(frame, time.time_ns()))
            self._turn.notify_all()
            return True


def _due_times() -> Callable[[float], float]:
    """When a file's frame of a time, in seconds, is due on `time.monotonic`: the first one at once."""
    begin: list[float] = []

    def due(seconds: float) -> float:
        begin[:] = begin or [time.monotonic() - seconds]
        return begin[0] + seconds

    return due
