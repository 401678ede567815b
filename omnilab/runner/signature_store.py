"""The descriptions by one descriptor, in files that many processes may read and write at once."""

from __future__ import annotations

import errno
import hashlib
import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from omnilab.api import Array, Bytes, Signatures
from omnilab.arrays import read_npz
from omnilab.atomic_files import PART, write_whole
from omnilab.file_kinds import content_of

KEY_BYTES = 16  # of an image's digest
ABOUT = "about.txt"  # names the descriptor; its digest is the name of the folder
LONGEST_ABOUT = 2**20  # bytes
LARGEST_FILE = 2**32  # bytes
DIGESTS = {"keys": 2, "of": 1}  # arrays of digests, and how many dimensions they have
OWN_NAME = re.compile(r"[0-9a-f]{32}\.npz|([0-9a-f]{32}(\.npz)?|about(\.txt)?)" + PART)
DAMAGED = (ValueError, MemoryError)
Arrays = dict[str, Array]


def keys_of(images: Bytes) -> list[bytes]:
    """The digest of each of N images: of its type, its shape and its pixels."""
    kind = f"{images.dtype.str} {images.shape[1:]} ".encode()
    return [hashlib.sha256(kind + image.tobytes()).digest()[:KEY_BYTES] for image in images]


def own_files(cache: Path) -> Iterator[Path]:
    """The files in a cache's folder that a `SignatureStore` wrote, by their names and by what the folder says of itself.

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


class SignatureStore:
    """A folder with one .npz file for each batch: the digests `keys` (N, 16) of its images and their signatures.

    A file is written under another name first and never changed afterwards: whoever writes may be killed at any time.
    It holds the digest of the folder, `of` (16,), and is named by that of its keys, and each array has a checksum: what
    was damaged, or belongs elsewhere, is removed, and `damaged` called with it and what was wrong. Others may own the
    folder, or allow it to be read alone.
    """

    def __init__(self, folder: Path, about: str, damaged: Callable[[Path, Exception], None]) -> None:
        self.folder = folder / _digest(about.encode())
        self._about = about
        self._of = np.frombuffer(bytes.fromhex(self.folder.name), np.uint8)
        self._damaged = damaged
        self._index: dict[bytes, tuple[Path, int]] = {}  # an image's digest: file and row
        self._seen: set[Path] = set()

    def load(self, keys: Sequence[bytes]) -> tuple[Signatures | None, list[int]]:
        """Room for the signatures of all, filled for those that are known (None if none is); and which these are."""
        if not self._index.keys() >= set(keys):
            self._refresh()
        wanted: dict[Path, list[tuple[int, int]]] = defaultdict(list)
        for position, key in enumerate(keys):
            if key in self._index:
                file, row = self._index[key]
                wanted[file].append((position, row))
        room: Signatures | None = None
        known: list[int] = []
        for file, pairs in wanted.items():
            arrays = self._read(file, ("keys", "place", "heading"))
            if arrays is None:
                continue
            stored = Signatures(arrays["place"], arrays.get("heading"))
            positions, rows = np.array(pairs).T
            wanted_keys = b"".join(keys[position] for position in positions)
            if rows.max() >= len(stored) or arrays["keys"][rows].tobytes() != wanted_keys:  # another is there by now
                continue
            room = room or empty_like(stored, len(keys))
            if not is_alike(stored, room):
                self._remove(file, ValueError(f"signatures of shape {stored.place.shape[1:]}"))
                continue
            put(room, positions, stored[rows])
            known += positions.tolist()
            with suppress(OSError):  # thrown away, or not ours to change
                os.utime(file)  # used last
        return room, known

    def store(self, keys: Sequence[bytes], made: Signatures) -> int:
        """Write one batch; how many bytes it takes. OSError if the disk does not take it."""
        self.folder.mkdir(parents=True, exist_ok=True)
        if self.folder.is_symlink():
            raise OSError(errno.ELOOP, f"{self.folder.name} in it is a link")
        if not is_own_folder(self.folder):  # new, or its writer was killed
            write_whole(self.folder / ABOUT, lambda out: out.write(self._about.encode()))
        joined = b"".join(keys)
        file = self.folder / f"{_digest(joined)}.npz"
        arrays: dict[str, Any] = {"keys": np.frombuffer(joined, np.uint8).reshape(-1, KEY_BYTES), "place": made.place}
        arrays["of"] = self._of
        arrays |= {} if made.heading is None else {"heading": made.heading}
        size = write_whole(file, lambda out: np.savez(out, **arrays))
        self._take_up(file, keys)
        return size

    def _refresh(self) -> None:
        """Take up the files that have appeared, by whatever process."""
        if self.folder.is_symlink():  # to what another may have chosen
            return
        for file in sorted(set(filter(_is_own, self.folder.glob("*.npz"))) - self._seen):
            self._seen.add(file)
            arrays = self._read(file, ("keys", "of"))
            if arrays is None:
                continue
            if not np.array_equal(arrays["of"], self._of) or file.stem != _digest(arrays["keys"].tobytes()):
                self._remove(file, ValueError("it is of other images or of another descriptor"))
                continue
            self._take_up(file, [key.tobytes() for key in arrays["keys"]])

    def _take_up(self, file: Path, keys: Sequence[bytes]) -> None:
        self._seen.add(file)
        self._index |= {key: (file, row) for row, key in enumerate(keys)}

    def _read(self, file: Path, names: Sequence[str]) -> Arrays | None:
        """Some arrays of a file (zip's checksums tell whether they are whole); None if it is gone or damaged."""
        try:
            arrays = read_npz(file, names, LARGEST_FILE)
            if lacking := [name for name in names if name != "heading" and name not in arrays]:
                raise ValueError(f"{lacking[0]} is missing")
            _check(arrays)
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


def _check(arrays: Arrays) -> None:
    """ValueError unless the arrays are such as `store` writes: those of a descriptor that keeps its contract."""
    keys = arrays["keys"]
    for name, array in arrays.items():
        if name in DIGESTS:
            fits = array.dtype == np.uint8 and array.ndim == DIGESTS[name] and array.shape[-1] == KEY_BYTES
        else:
            fits = array.dtype == np.float32 and array.ndim > 1 and len(array) == len(keys) and 0 not in array.shape
        if not fits:
            raise ValueError(f"{name} is {array.dtype} {array.shape}")
        if name not in DIGESTS and not np.isfinite(array).all():
            raise ValueError(f"{name} holds NaN or infinity")


def empty_like(signatures: Signatures, count: int) -> Signatures:
    """Room for `count` signatures."""
    heading = signatures.heading
    return Signatures(
        np.empty((count, *signatures.place.shape[1:]), np.float32),
        None if heading is None else np.empty((count, *heading.shape[1:]), np.float32),
    )


def is_alike(one: Signatures, other: Signatures) -> bool:
    """Whether their parts have the same shapes."""
    shapes = [[p.shape[1:] for p in (s.place, s.heading) if p is not None] for s in (one, other)]
    return shapes[0] == shapes[1]


def put(room: Signatures, where: Sequence[int] | npt.NDArray[Any], signatures: Signatures) -> None:
    """Copy signatures to their places."""
    room.place[where] = signatures.place
    if room.heading is not None and signatures.heading is not None:
        room.heading[where] = signatures.heading
