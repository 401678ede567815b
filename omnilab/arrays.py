"""NumPy's files, .npy and uncompressed .npz, as they come from strangers: nothing is unpickled, and nothing is read that is
larger than the file."""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from tokenize import TokenError
from typing import IO

import numpy as np

from omnilab.api import Array

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


def read_npz(path: Path, wanted: Collection[str] | None = None) -> dict[str, Array]:
    """The arrays of an archive that `np.savez` wrote, by name, or those of the wanted ones that it has.

    ValueError, which says what is wrong, if it is damaged, compressed (a small file may unpack to any size), or holds
    anything else; OSError if it cannot be read.
    """
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        try:
            with zipfile.ZipFile(file) as archive:
                members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
                names = members if wanted is None else [name for name in wanted if name in members]
                return {name: _member(archive, members[name], name, size) for name in names}
        except (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, zlib.error, OSError) as error:
            raise ValueError("it is no whole archive of arrays") from error


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
