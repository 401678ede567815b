"""NumPy's files, .npy and uncompressed .npz, as they come from strangers: nothing is unpickled, and nothing is read that is
larger than the file."""

from __future__ import annotations

import io
import sys
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from tokenize import TokenError
from typing import IO

import numpy as np

from omnilab.api import Array
from omnilab.file_kinds import opened

LARGEST_DIRECTORY = 2**20  # bytes, of an archive's members: some 10,000
LONGEST_END = 2**16 + 256  # bytes, that follow the directory

UNREADABLE = (ValueError, SyntaxError, TokenError, TypeError, OverflowError, RecursionError, MemoryError)


def read_npy(file: IO[bytes], size: int) -> Array:
    """The array in a stream of `size` bytes; ValueError, which says what it is instead, if it holds no array of numbers."""
    try:
        version = np.lib.format.read_magic(file)
        if version != (1, 0):
            raise ValueError
        shape, in_columns, kind = np.lib.format.read_array_header_1_0(file)
    except UNREADABLE:
        raise ValueError("it is no array of NumPy's format 1.0") from None
    claimed, held = int(np.prod(shape, dtype=object)) * kind.itemsize, size - file.tell()
    if kind.hasobject or kind.itemsize == 0 or min(shape, default=0) < 0 or claimed != held:
        raise ValueError(f"it claims {claimed} bytes and has {held}, of {kind} {shape}")
    data = np.frombuffer(file.read(claimed), kind, count=claimed // kind.itemsize)
    if kind.kind == "U":
        points = data.view(np.dtype(np.uint32).newbyteorder(kind.byteorder))
        if ((points > 0x10FFFF) | ((points >= 0xD800) & (points < 0xE000))).any():
            raise ValueError("it holds characters that do not exist")
    return data.reshape(shape, order="F" if in_columns else "C").copy()


def read_npz(path: Path, wanted: Collection[str] | None = None, largest: int = sys.maxsize) -> dict[str, Array]:
    """The arrays of an archive that `np.savez` wrote, by name, or those of the wanted ones that it has.

    ValueError, which says what is wrong, if it is damaged, compressed (a small file may unpack to any size), or holds
    anything else; OSError if it cannot be read, is no regular file or has more than `largest` bytes.
    """
    with opened(path, largest) as file:
        size = file.seek(0, io.SEEK_END)
        _check_directory(file, size)
        try:
            with zipfile.ZipFile(file) as archive:
                if sum(info.file_size for info in archive.infolist()) > size:
                    raise ValueError("its arrays are compressed, or larger than the file")
                members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
                names = members if wanted is None else [name for name in wanted if name in members]
                return {name: _member(archive, members[name], name, size) for name in names}
        except (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, zlib.error, OSError) as error:
            raise ValueError("it is no whole archive of arrays") from error


def _check_directory(file: IO[bytes], size: int) -> None:
    """ValueError for an archive of more members than any of ours has: `zipfile` makes an object of each."""
    file.seek(max(0, size - LONGEST_END))
    end = file.read()
    bare = end[-22:-18] == b"PK\5\6" and end[-2:] == b"\0\0"  # without a comment; found as `zipfile` finds it
    at = len(end) - 22 if bare else end.rfind(b"PK\5\6")
    held = int.from_bytes(end[at + 12 : at + 16], "little")
    if at >= 76 and end[at - 20 : at - 16] == b"PK\6\7":  # zip64
        held = int.from_bytes(end[at - 36 : at - 28], "little")
    if at >= 0 and held > LARGEST_DIRECTORY:
        raise ValueError("it has too many members")


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, size: int) -> Array:
    if info.compress_type != zipfile.ZIP_STORED or info.file_size > size:
        raise ValueError(f"{name} is compressed, or larger than the file")
    try:
        with archive.open(info) as file:
            array = read_npy(file, info.file_size)
            file.read(1)  # the end: where the checksum is compared
        return array
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
