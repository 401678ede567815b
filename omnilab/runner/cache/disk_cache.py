"""Results on disk: a sweep over descriptors renders each image once, one over distances describes each once."""

from __future__ import annotations

import logging
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, fields
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omnilab.runner.cache.kept_methods import KeptMethod, kept_method
from omnilab.runner.cache.row_store import Arrays, RowStore, is_alike, own_files, put
from omnilab.runner.fingerprint import fingerprint

log = logging.getLogger("omnilab")

FORMAT = 2  # of the files
STALE_S = 3600.0  # what is still unfinished then was left by a process that died
KEPT = 0.9  # of the limit, when it was passed


class DiskCache:
    """Keeps what descriptors say about images and what virtual cameras render, and gives it back bit for bit.

    In its folder each component has a folder, named by the digest of its `fingerprint`, which is in `about.txt`. When
    these files take more than `limit_bytes`, those that were used longest ago go; nothing else in the folder is counted
    or touched. What is wrong with a file or with the disk is logged once, and costs only the saving.
    """

    def __init__(self, folder: Path, limit_bytes: int, threads: int) -> None:
        self.folder = folder
        self.limit_bytes = limit_bytes
        self.threads = threads  # of matrix products: with another number, sums may differ in the last bits
        self.found: Counter[str] = Counter()  # images that had been described, or rendered, before
        self.made: Counter[str] = Counter()  # images that had not
        self._classes: dict[type[Any], type[Any]] = {}
        self._computed_on: dict[type[Any], str] = {}
        self._stores: dict[str, RowStore | None] = {}
        self._logged: set[str] = set()
        self._used: Counter[str] = Counter()  # bytes that were read and written
        self._bytes: int | None = None  # in the folder; None: not counted yet

    def __reduce__(self) -> tuple[Any, ...]:
        return DiskCache, (self.folder, self.limit_bytes, self.threads)

    def wrap(self, component: Any, computed_on: str = "") -> Any:
        """A component like the given one, of a class derived from its own, that looks here before it makes anything.

        One that makes nothing that is kept is given back as it is. What is `computed_on` a device other than the processor
        is kept apart.
        """
        cls, method = type(component), kept_method(component)
        if method is None:
            return component
        if cls not in self._classes:
            self._computed_on[cls] = computed_on
            members = {
                "__module__": cls.__module__,
                "__qualname__": cls.__qualname__,
                "__doc__": cls.__doc__,
                "__reduce__": lambda own: (self.wrap, (_as(cls, own), computed_on)),
                method.name: self._override(method, cls),
            }
            self._classes[cls] = type(cls.__name__, (cls,), members)
        return _as(self._classes[cls], component)

    def _override(self, method: KeptMethod, cls: type[Any]) -> Callable[..., Any]:
        """The method of `cls`, by arguments of the same names, as one that looks here first."""
        plain = getattr(cls, method.name)
        names = signature(plain)

        @wraps(plain)
        def override(*given: Any, **named: Any) -> Any:
            component, *rest = names.bind(*given, **named).args
            return self._result(method, cls, component, tuple(rest))

        return override

    def _result(self, method: KeptMethod, cls: type[Any], component: Any, given: tuple[Any, ...]) -> Any:
        """What the method says of all rows; only those that are not known are given to it, in one batch."""

        def make(*given: Any) -> Any:
            return getattr(cls, method.name)(component, *given)

        store = self._store_of(method, cls, component)
        keys = [] if store is None else method.keys(component, *given)
        if store is None or not keys:
            return make(*given)
        room, known = self._load(store, keys)
        missing = np.setdiff1d(np.arange(len(keys)), known)
        self._used[method.name] += 0 if room is None else _size(room) * len(known) // len(keys)
        if room is None:
            result = make(*given)
            self._save(method, store, keys, method.sound(result, len(keys)))
        elif len(missing) == 0:
            result = method.result(room)
        else:
            rest = method.sound(make(*method.rows(missing, *given)), len(missing))
            if rest is None or not is_alike(rest, room):
                return make(*given)
            self._save(method, store, [keys[i] for i in missing], rest)
            put(room, missing, rest, slice(None))
            result = method.result(room)
        self.found[method.name] += len(known)
        self.made[method.name] += len(missing)
        return result

    def _store_of(self, method: KeptMethod, cls: type[Any], component: Any) -> RowStore | None:
        """Where the results of a component with its present settings lie; None if they cannot be kept."""
        settings = f"{cls.__module__}.{cls.__qualname__} {asdict(component)}"
        if settings not in self._stores:
            about = fingerprint(component)
            if about is None:
                log.info("not cached, since a setting names a folder or there is no source file: %s", settings)
            device = f"device {self._computed_on[cls]}\n" if self._computed_on[cls] else ""
            about = about and f"format {FORMAT}\nthreads {self.threads}\n{device}{about}\n"
            damaged = self._damaged(method)
            self._stores[settings] = RowStore(self.folder, about, method.parts, damaged) if about else None
        return self._stores[settings]

    def _load(self, store: RowStore, keys: list[bytes]) -> tuple[Arrays | None, list[int]]:
        try:
            return store.load(keys)
        except OSError as error:
            self._warn_once(
                "read", f"the cache {self.folder} cannot be read ({error.strerror}), the run goes on without it"
            )
            return None, []

    def _save(self, method: KeptMethod, store: RowStore, keys: list[bytes], made: Arrays | None) -> None:
        if "written" in self._logged or made is None:
            return
        try:
            if not self._has_room(method, _size(made)):
                return
            size = store.store(keys, made)
            self._used[method.name] += size
            self._bytes = sum(file.size for file in _files(self.folder)) if self._bytes is None else self._bytes + size
            if self._bytes > self.limit_bytes:
                self._make_room()
        except OSError as error:
            self._warn_once("written", f"the cache {self.folder} cannot be written ({error.strerror}), the run goes on;"
                      " free some space, or give cache=DIR or cache=off")  # fmt: skip

    def _has_room(self, method: KeptMethod, size: int) -> bool:
        """Whether so many bytes more are within what one run may use, and leave enough of the disk free."""
        if self._used[method.name] + size > method.share * self.limit_bytes:
            why = f"those of this run are {method.share:.0%} of cache_gb={self.limit_bytes / 1e9:g}"
        elif method.spare_bytes:
            self.folder.mkdir(parents=True, exist_ok=True)
            if shutil.disk_usage(self.folder).free - size >= method.spare_bytes:
                return True
            why = f"the disk of {self.folder} has less than {method.spare_bytes / 1e9:g} GB left"
        else:
            return True
        if method.name not in self._logged:
            self._logged.add(method.name)
            log.info("no more images are kept as they are %s: %s", method.made, why)
        return False

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

    def _damaged(self, method: KeptMethod) -> Callable[[Path, Exception], None]:
        def warn(file: Path, error: Exception) -> None:
            self._warn_once("whole", f"{file} in the cache is damaged ({error}); its images are {method.made} anew")

        return warn

    def _warn_once(self, what: str, sentence: str) -> None:
        """Once a run."""
        if what not in self._logged:
            self._logged.add(what)
            log.warning("%s", sentence)


def _size(arrays: Arrays) -> int:
    return sum(array.nbytes for array in arrays.values())


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
