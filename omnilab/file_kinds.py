"""What a file is: regular and of bounded size, or never opened; and by its first bytes, so that one given in the wrong place
is named for what it is."""

from __future__ import annotations

import errno
import io
import os
import re
import stat
import sys
from pathlib import Path

HEAD = 4096  # bytes that are looked at
MAGIC = {  # first bytes: what such a file is
    b"\x89MCAP0\r\n": "an MCAP log",
    b"#ROSBAG V": "a ROS 1 bag",
    b"SQLite format 3\x00": "an SQLite database (a ROS 2 bag, say)",
    b"PAR1": "a Parquet table",
    b"\x89HDF\r\n\x1a\n": "an HDF5 file (MATLAB writes those, too)",
    b"MATLAB 5.0 MAT-file": "a MATLAB file",
    b"\x93NUMPY": "a NumPy array",
    b"\xd0\xcf\x11\xe0": "an old Office document (.xls, say)",
    b"\x1f\x8b": "compressed by gzip",
    b"BZh": "compressed by bzip2",
    b"\xfd7zXZ\x00": "compressed by xz",
    b"\x28\xb5\x2f\xfd": "compressed by zstd",
    b"7z\xbc\xaf\x27\x1c": "a 7z archive",
    b"Rar!": "a RAR archive",
    b"RRF2": "a Rerun recording",
    b"RRIO": "a Rerun recording",
    b"%PDF": "a PDF",
    b"\x89PNG": "a PNG picture",
    b"\xff\xd8\xff": "a JPEG picture",
    b"II*\x00": "a TIFF picture",
    b"MM\x00*": "a TIFF picture",
    b"ply\n": "a PLY mesh or point cloud",
    b"ply\r": "a PLY mesh or point cloud",
    b"glTF": "a glTF mesh",
    b"\xff\xfe": "text in UTF-16 (save it as UTF-8)",
    b"\xfe\xff": "text in UTF-16 (save it as UTF-8)",
}
ZIPPED = {  # a zip archive, by the name of something in it
    b"xl/": "an Excel workbook",
    b"[Content_Types].xml": "an Office document (an Excel workbook, say)",
    b"mimetypeapplication/vnd.oasis.opendocument": "an OpenDocument table",
    b".npy": "a NumPy archive (.npz)",
    b".pkl": "a PyTorch model",
}
POSE_GRAPH = "a pose graph (g2o or TORO)"
GRAPH = re.compile(rb"\s*(?:#[^\n]*\n\s*)*(VERTEX|EDGE)")


def opened(file: str | Path, largest: int) -> io.BufferedReader | io.BytesIO:
    """A regular file of up to `largest` bytes, open; OSError, whose `strerror` says why, where there is none.

    Never waits for a pipe, and never opens a device. What says that it is empty is not read: files of /proc may not end.
    """
    descriptor, size = _descriptor(file, largest)
    if size == 0:
        os.close(descriptor)
        return io.BytesIO()
    return os.fdopen(descriptor, "rb")


def content_of(file: str | Path, largest: int) -> bytes:
    """The bytes of a regular file of up to `largest` of them; errors as of `opened`."""
    descriptor, size = _descriptor(file, largest)
    try:
        content = os.read(descriptor, size) if size else b""
        while len(content) < size and (more := os.read(descriptor, size - len(content))):  # the system's own limit
            content += more
        return content
    finally:
        os.close(descriptor)


def _descriptor(file: str | Path, largest: int) -> tuple[int, int]:
    """Of a regular file, and the file's size; errors as of `opened`."""
    _check(_stat(file), largest)
    descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        found = os.fstat(descriptor)
        _check(found, largest)  # another may have taken its place
    except OSError:
        os.close(descriptor)
        raise
    return descriptor, found.st_size


def has_longer_line(data: bytes, most: int) -> bool:
    """Whether a text has a line of more than `most` bytes."""
    at = 0
    while len(data) - at > most:
        end = max(data.rfind(newline, at, at + most + 1) for newline in (b"\n", b"\r"))
        if end < 0:
            return True
        at = end + 1
    return False


def is_folder(path: str | Path) -> bool:
    """Whether there is a folder of this name; False for what no name may be, or nobody may look at."""
    return os.path.isdir(path)  # noqa: PTH112  pathlib raises for some of these


def is_file(path: str | Path) -> bool:
    """Whether there is a regular file of this name; False for what no name may be, or nobody may look at."""
    return os.path.isfile(path)  # noqa: PTH113


def _stat(file: str | Path) -> os.stat_result:
    if "\0" in str(file):
        raise OSError(errno.EINVAL, "its name holds the character NUL")
    return os.stat(file)  # noqa: PTH116  a thousand times a second


def _check(found: os.stat_result, largest: int) -> None:
    if not stat.S_ISREG(found.st_mode):
        if stat.S_ISDIR(found.st_mode):
            raise OSError(errno.EISDIR, "it is a folder")
        raise OSError(errno.EINVAL, "it is a pipe or a device, no file")
    if found.st_size > largest:
        raise OSError(errno.EFBIG, f"it has {found.st_size} bytes, more than {largest}")


def kind_of_file(file: Path) -> str | None:
    """What a file is, as words that follow "is": "an MCAP log", "a folder". None: plain text, or nothing known.

    Never reads a pipe or a device. OSError where there is nothing, or it cannot be read.
    """
    mode = _stat(file).st_mode
    if stat.S_ISDIR(mode):
        return "the folder of a ROS 2 bag" if (file / "metadata.yaml").is_file() else "a folder"
    if not stat.S_ISREG(mode):
        return "a pipe or a device, no file"
    with opened(file, sys.maxsize) as stream:
        head = stream.read(HEAD)
    return _kind_of(head)


def _kind_of(head: bytes) -> str | None:
    if head.startswith(b"PK\x03\x04"):
        return next((kind for within, kind in ZIPPED.items() if within in head), "a zip archive")
    for magic, kind in MAGIC.items():
        if head.startswith(magic):
            return kind
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if text.startswith(b"{") or re.match(rb"\[\s*[\[{\"\]\d-]", text):
        return "JSON"
    if re.match(rb"<[?!a-zA-Z]", text):
        return "HTML" if re.match(rb"<(!doctype )?html", text, re.IGNORECASE) else "XML"
    if head[:1] == b"\x80" and head[1:2] in b"\x02\x03\x04\x05":
        return "a Python pickle, which is never read"
    if GRAPH.match(text):
        return POSE_GRAPH
    return "a binary file" if b"\x00" in head else None


def how_to_export(file: Path, kind: str) -> str:
    """What to do with a log of ROS instead of giving it where a text of poses is read; "" for what is no such log."""
    words = {"an MCAP log": "bag2", "the folder of a ROS 2 bag": "bag2", "a ROS 1 bag": "bag"}
    words["an SQLite database (a ROS 2 bag, say)"] = "bag2"
    if kind not in words:
        return ""
    log = file.parent if kind.startswith("an SQLite") else file
    return f"export a topic of it with evo, evo_traj {words[kind]} {log} /odom --save_as_tum, and give the .tum"
