"""What one component made, row by row, in files that many processes may read and write at once."""

from __future__ import annotations

import errno
import hashlib
import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Array, Ints
from omnilab.arrays import read_npz
from omnilab.atomic_files import PART, write_whole
from omnilab.file_kinds import content_of

KEY_BYTES = 16  # of a row's digest
FILE_BYTES = 2**24  # of a file, about: what is read for one of its rows
ABOUT = "about.txt"  # names the component; its digest is the name of the folder
LONGEST_ABOUT = 2**20  # bytes
LARGEST_FILE = 2**32  # bytes
OWN_NAME = re.compile(r"[0-9a-f]{32}\.npz|([0-9a-f]{32}(\.npz)?|about(\.txt)?)" + PART)
DAMAGED = (ValueError, MemoryError)
Arrays = dict[str, Array]


class ArrayKind(NamedTuple):
    """What one of the arrays of a file may be, beside as long as its keys and not empty."""

    kind: type[np.generic]
    dimensions: tuple[int, int]  # at least, at most
    unsound: str = ""  # what it holds where `is_sound` does not
    is_sound: Callable[[Array], Any] = np.ones_like  # number by number
    optional: bool = False

    def complaint(self, array: Array) -> str:
        """What is wrong with an array; "" for nothing."""
        if array.dtype != self.kind or not self.dimensions[0] <= array.ndim <= self.dimensions[1] or array.size == 0:
            return f"is {array.dtype} {array.shape}"
        return f"holds {self.unsound}" if self.unsound and not np.all(self.is_sound(array)) else ""


Parts = Mapping[str, ArrayKind]
DIGESTS: Parts = {"keys": ArrayKind(np.uint8, (2, 2)), "of": ArrayKind(np.uint8, (1, 1))}


def own_files(cache: Path) -> Iterator[Path]:
    """The files in a cache's folder that a `RowStore` wrote, by their names and by what the folder says of itself.

    The folder may be one that the user keeps other things in: what is not surely ours is not to be counted nor removed.
    """
    for about in cache.glob(f"*/{ABOUT}"):
        if is_own_folder(about.parent):
            with suppress(OSError):  # thrown away meanwhile, or not ours to read
                yield from (file for file in about.parent.iterdir() if _is_own(file))


def is_own_folder(folder: Path) -> bool:
    """Whether the folder is named by the digest of what its `about.txt` says, and is no link to one elsewhere."""
    about = folder / ABOUT
    try:
        if folder.is_symlink() or not _is_plain(about):
            return False
        return folder.name == _digest(content_of(about, LONGEST_ABOUT))
    except OSError:  # thrown away meanwhile, or not ours to read
        return False


def _is_own(file: Path) -> bool:
    """Whether a file in a folder of ours is ours."""
    return OWN_NAME.fullmatch(file.name) is not None and _is_plain(file)


def _is_plain(file: Path) -> bool:
    """Whether it is a regular file, no link to one elsewhere."""
    return file.is_file() and not file.is_symlink()


def _digest(about: bytes) -> str:
    return hashlib.sha256(about).hexdigest()[:32]


class RowStore:
    """A folder with .npz files, a few for each batch: the digests `keys` (N, 16) of its rows, and arrays of N rows each.

    A file is written under another name first and never changed afterwards: whoever writes may be killed at any time.
    It holds the digest of the folder, `of` (16,), and is named by that of its keys, and each array has a checksum: what
    was damaged, or belongs elsewhere, is removed, and `damaged` called with it and what was wrong. Others may own the
    folder, or allow it to be read alone.
    """

    def __init__(self, folder: Path, about: str, parts: Parts, damaged: Callable[[Path, Exception], None]) -> None:
        self.folder = folder / _digest(about.encode())
        self._about = about
        self._parts = parts  # which arrays
        self._of = np.frombuffer(bytes.fromhex(self.folder.name), np.uint8)
        self._damaged = damaged
        self._index: dict[bytes, tuple[Path, int]] = {}  # a row's digest: file and row in it
        self._seen: set[Path] = set()

    def load(self, keys: Sequence[bytes]) -> tuple[Arrays | None, list[int]]:
        """Room for all rows, filled where they are known (None if none is); and which these are."""
        if not self._index.keys() >= set(keys):
            self._refresh()
        wanted: dict[Path, list[tuple[int, int]]] = defaultdict(list)
        for position, key in enumerate(keys):
            if key in self._index:
                file, row = self._index[key]
                wanted[file].append((position, row))
        room: Arrays | None = None
        known: list[int] = []
        for file, pairs in wanted.items():
            stored = self._read(file, ("keys", *self._parts))
            if stored is None:
                continue
            held = stored.pop("keys")
            positions, rows = np.array(pairs).T
            wanted_keys = b"".join(keys[position] for position in positions)
            if rows.max() >= len(held) or held[rows].tobytes() != wanted_keys:  # another is there by now
                continue
            room = room or empty_like(stored, len(keys))
            if not is_alike(stored, room):
                self._remove(file, ValueError(f"rows of {shapes(stored)}, not of {shapes(room)}"))
                continue
            put(room, positions, stored, rows)
            known += positions.tolist()
            with suppress(OSError):  # thrown away, or not ours to change
                os.utime(file)  # used last
        return room, known

    def store(self, keys: Sequence[bytes], made: Arrays) -> int:
        """Write rows; how many bytes they take. OSError if the disk does not take them."""
        self.folder.mkdir(parents=True, exist_ok=True)
        if self.folder.is_symlink():
            raise OSError(errno.ELOOP, f"{self.folder.name} in it is a link")
        if not is_own_folder(self.folder):  # new, or its writer was killed
            write_whole(self.folder / ABOUT, lambda out: out.write(self._about.encode()))
        step = max(1, FILE_BYTES * len(keys) // max(1, sum(array.nbytes for array in made.values())))
        parts = [slice(start, start + step) for start in range(0, len(keys), step)]
        return sum(self._write(keys[part], {name: array[part] for name, array in made.items()}) for part in parts)

    def _write(self, keys: Sequence[bytes], made: Arrays) -> int:
        """Write one file."""
        joined = b"".join(keys)
        file = self.folder / f"{_digest(joined)}.npz"
        arrays = {"keys": np.frombuffer(joined, np.uint8).reshape(-1, KEY_BYTES), "of": self._of, **made}
        size = write_whole(file, lambda out: np.savez(out, **arrays))  # type: ignore[arg-type]
        self._take_up(file, keys)
        return size

    def _refresh(self) -> None:
        """Take up the files that have appeared, by whatever process."""
        if self.folder.is_symlink():  # to what another may have chosen
            return
        for file in sorted(filter(_is_own, set(self.folder.glob("*.npz")) - self._seen)):
            self._seen.add(file)
            arrays = self._read(file, ("keys", "of"))
            if arrays is None:
                continue
            if not np.array_equal(arrays["of"], self._of) or file.stem != _digest(arrays["keys"].tobytes()):
                self._remove(file, ValueError("it is of other images or of another component"))
                continue
            self._take_up(file, [key.tobytes() for key in arrays["keys"]])

    def _take_up(self, file: Path, keys: Sequence[bytes]) -> None:
        self._seen.add(file)
        self._index |= {key: (file, row) for row, key in enumerate(keys)}

    def _read(self, file: Path, names: Sequence[str]) -> Arrays | None:
        """Some arrays of a file (zip's checksums tell whether they are whole); None if it is gone or damaged."""
        try:
            arrays = read_npz(file, names, LARGEST_FILE)
            for name in names:
                self._check(name, arrays)
        except FileNotFoundError:  # thrown away, by another process
            return None
        except DAMAGED as error:
            self._remove(file, error)
            return None
        except OSError as error:
            self._damaged(file, error)
            return None
        return arrays

    def _remove(self, file: Path, error: Exception) -> None:
        with suppress(OSError):  # it may belong to another user
            if is_own_folder(self.folder):
                file.unlink(missing_ok=True)
        self._damaged(file, error)

    def _check(self, name: str, arrays: Arrays) -> None:
        """ValueError unless the array is such as `store` writes: one of a component that keeps its contract."""
        part = DIGESTS.get(name) or self._parts[name]
        if name not in arrays:
            if not part.optional:
                raise ValueError(f"{name} is missing")
            return
        array = arrays[name]
        fits = array.shape[-1:] == (KEY_BYTES,) if name in DIGESTS else len(array[..., None]) == len(arrays["keys"])
        if complaint := part.complaint(array) or ("" if fits else f"is {array.dtype} {array.shape}"):
            raise ValueError(f"{name} {complaint}")


def empty_like(arrays: Arrays, count: int) -> Arrays:
    """Room for `count` rows."""
    return {name: np.empty((count, *array.shape[1:]), array.dtype) for name, array in arrays.items()}


def shapes(arrays: Arrays) -> dict[str, tuple[int, ...]]:
    """The shape of a row, by array."""
    return {name: array.shape[1:] for name, array in arrays.items()}


def is_alike(one: Arrays, other: Arrays) -> bool:
    """Whether their rows have the same shapes."""
    return shapes(one) == shapes(other)


def put(room: Arrays, where: Ints, arrays: Arrays, rows: Ints | slice) -> None:
    """Copy some rows to their places."""
    for name, array in arrays.items():
        room[name][where] = array[rows]
