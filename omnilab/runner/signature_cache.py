"""Descriptions on disk: a sweep over distances, localizers or disturbances describes each image once."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Bytes, Signatures, Trainable, is_cached
from omnilab.runner.fingerprint import fingerprint
from omnilab.runner.signature_store import SignatureStore, is_alike, keys_of, own_files, put

log = logging.getLogger("omnilab")

FORMAT = 2  # of the files
STALE_S = 3600.0  # what is still unfinished then was left by a process that died
KEPT = 0.9  # of the limit, when it was passed


class SignatureCache:
    """Keeps what descriptors say about images, and gives it back bit for bit.

    In its folder each descriptor has a folder, named by the digest of its `fingerprint`, which is in `about.txt`. When
    these files take more than `limit_bytes`, those that were used longest ago go; nothing else in the folder is counted
    or touched. What is wrong with a file or with the disk is logged once, and costs only the saving.
    """

    def __init__(self, folder: Path, limit_bytes: int, threads: int) -> None:
        self.folder = folder
        self.limit_bytes = limit_bytes
        self.threads = threads  # of matrix products: with another number, sums may differ in the last bits
        self.found = 0  # images that had been described before
        self.made = 0  # images that had not
        self._classes: dict[type[Any], type[Any]] = {}
        self._stores: dict[str, SignatureStore | None] = {}
        self._logged: set[str] = set()
        self._bytes: int | None = None  # in the folder; None: not counted yet

    def __reduce__(self) -> tuple[Any, ...]:
        return SignatureCache, (self.folder, self.limit_bytes, self.threads)

    def wrap(self, descriptor: Any) -> Any:
        """A descriptor like the given one, of a class derived from its own, that looks here before it describes.

        One that learns from the map, or says `cached = False`, is given back as it is.
        """
        cls = type(descriptor)
        if isinstance(descriptor, Trainable) or not is_cached(cls):
            return descriptor
        if cls not in self._classes:
            members = {
                "__module__": cls.__module__,
                "__qualname__": cls.__qualname__,
                "__doc__": cls.__doc__,
                "__reduce__": lambda own: (self.wrap, (_as(cls, own),)),
                "describe": lambda own, images: self._describe(cls, own, images),
            }
            self._classes[cls] = type(cls.__name__, (cls,), members)
        return _as(self._classes[cls], descriptor)

    def _describe(self, cls: type[Any], descriptor: Any, images: Bytes) -> Signatures:
        """What `cls.describe` says; only images that are not known are given to it, in one batch."""
        store = self._store_of(cls, descriptor)
        if store is None or len(images) == 0:
            return cls.describe(descriptor, images)  # type: ignore[no-any-return]
        keys = keys_of(images)
        room, known = self._load(store, keys)
        if room is None:
            made: Signatures = cls.describe(descriptor, images)
            self._save(store, keys, made)
            self.made += len(images)
            return made
        missing = np.setdiff1d(np.arange(len(images)), known)
        if len(missing):
            rest: Signatures = cls.describe(descriptor, images[missing])
            if not _is_sound(rest, len(missing)) or not is_alike(rest, room):
                return cls.describe(descriptor, images)  # type: ignore[no-any-return]
            self._save(store, [keys[i] for i in missing], rest)
            put(room, missing, rest)
        self.found += len(known)
        self.made += len(missing)
        return room

    def _store_of(self, cls: type[Any], descriptor: Any) -> SignatureStore | None:
        """Where the descriptions by a descriptor with its present settings lie; None if they cannot be kept."""
        settings = f"{cls.__module__}.{cls.__qualname__} {asdict(descriptor)}"
        if settings not in self._stores:
            about = fingerprint(descriptor)
            if about is None:
                log.info("not cached, since a setting names a folder or there is no source file: %s", settings)
            about = about and f"format {FORMAT}\nthreads {self.threads}\n{about}\n"
            self._stores[settings] = SignatureStore(self.folder, about, self._damaged) if about else None
        return self._stores[settings]

    def _load(self, store: SignatureStore, keys: list[bytes]) -> tuple[Signatures | None, list[int]]:
        try:
            return store.load(keys)
        except OSError as error:
            self._warn_once(
                "read", f"the cache {self.folder} cannot be read ({error.strerror}), the run goes on without it"
            )
            return None, []

    def _save(self, store: SignatureStore, keys: list[bytes], made: Signatures) -> None:
        if "written" in self._logged or not _is_sound(made, len(keys)):
            return
        try:
            size = store.store(keys, made)
            self._bytes = sum(file.size for file in _files(self.folder)) if self._bytes is None else self._bytes + size
            if self._bytes > self.limit_bytes:
                self._make_room()
        except OSError as error:
            self._warn_once("written", f"the cache {self.folder} cannot be written ({error.strerror}), the run goes on;"
                      " free some space, or give cache=DIR or cache=off")  # fmt: skip

    def _make_room(self) -> None:
        """Throw away what was used longest ago, and what writers left that died."""
        files = sorted(_files(self.folder), key=lambda file: file.used)
        left = sum(file.size for file in files)
        for file in files:
            is_left_over = file.path.suffix == ".part" and time.time() - file.used > STALE_S
            if is_left_over or (left > KEPT * self.limit_bytes and file.path.suffix == ".npz"):
                file.path.unlink(missing_ok=True)
                left -= file.size
        self._bytes = left

    def _damaged(self, file: Path, error: Exception) -> None:
        self._warn_once("whole", f"{file} in the cache is damaged ({error}); its images are described anew")

    def _warn_once(self, what: str, sentence: str) -> None:
        """Once a run."""
        if what not in self._logged:
            self._logged.add(what)
            log.warning("%s", sentence)


class _File(NamedTuple):
    path: Path
    size: int  # bytes
    used: float  # when, by the clock of the disk


def _files(folder: Path) -> Iterator[_File]:
    """All files of ours, which take space; other processes may be at work."""
    for path in own_files(folder):
        with suppress(FileNotFoundError):
            stat = path.stat()
            yield _File(path, stat.st_size, stat.st_mtime)


def _as(cls: type[Any], component: Any) -> Any:
    """A component as an instance of a class derived from its own, or the reverse; its settings and its state."""
    other = object.__new__(cls)
    state = {f.name: getattr(component, f.name) for f in fields(component)} | getattr(component, "__dict__", {})
    for name, value in state.items():
        object.__setattr__(other, name, value)
    return other


def _is_sound(signatures: Any, count: int) -> bool:
    """Whether a file can hold them: what breaks the contract is for the study to find.

    Arrays come back in C order; another order could change the last bits of sums over them.
    """
    if not isinstance(signatures, Signatures):
        return False
    parts = [p for p in (signatures.place, signatures.heading) if p is not None]
    return all(
        type(p) is np.ndarray and p.dtype == np.float32 and p.ndim > 1 and len(p) == count
        and p.flags.c_contiguous and np.isfinite(p).all()
        for p in parts
    )  # fmt: skip
