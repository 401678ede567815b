"""Copies of what URLs name, in the cache: fetched once for each version, whole or not there, never more than the cache may hold.

`CACHE/fetched/KEY/NAME` is the copy, a file or a folder; KEY is the digest of the URL and of names, sizes and versions of
all that it names, which are looked up each time. Nothing is ever removed: another process may be reading it.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import re
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import aiohttp
import fsspec

from omnilab.atomic_files import write_whole
from omnilab.errors import ConfigError, DataError, OmnilabError, of_machine
from omnilab.limits import check_work, size
from omnilab.runner.storage.listing import RemoteFile, listing
from omnilab.runner.storage.urls import last_name, protocol_of
from omnilab.runner.terminal import print_error

AT_ONCE = 16  # files, each of which waits for the network
CHUNK = 2**20  # bytes
PART = 1024  # files whose fetching is planned at a time
SHOWN_S = 5.0  # between lines on the progress
SILENCE_S = 60.0  # of a web server
URL = "url.json"  # beside a copy: whose it is


class Limits(NamedTuple):
    """What all copies together may take."""

    gb: float  # 1e9 bytes
    disk: bool  # whether the disk must have that much free


def fetched(name: str, url: str, folder: Path, limits: Limits) -> Path:
    """The local copy of what the URL of a setting names, which is fetched where it is not there in this version.

    `folder`: of all copies. ConfigError if they would be too large; DataError, in a sentence, if it is not there, may not be
    read, or changes meanwhile.
    """
    with _in_sentences(name, url, folder):
        store, path = _store(url)
        there = listing(store, path, url)
        key = hashlib.sha256(json.dumps([url, there]).encode()).hexdigest()[:32]
        copy = folder / key / last_name(url)
        if _lacking(copy, there):
            _check_room(name, url, _lacking(copy, there), folder, limits)
            copy.parent.mkdir(parents=True, exist_ok=True)
            with _alone(copy.parent, url):
                if lacking := _lacking(copy, there):  # another process may have fetched it meanwhile
                    (copy.parent / URL).write_text(json.dumps(url))
                    print_error(f"{name}: {_amount(lacking)} of {url} are fetched into {copy}")
                    Fetching(store, copy, lacking, url).run()
                    if listing(store, path, url) != there:
                        raise DataError(f"{name}={url} changed while it was fetched; run it again")
        return copy


class Fetching:
    """Fetches files beside a copy, then puts each, whole, into its place."""

    def __init__(self, store: Any, copy: Path, files: Sequence[RemoteFile], url: str) -> None:
        self._store, self._copy, self._files, self._url = store, copy, files, url
        self._bytes, self._total = 0, _bytes(files)
        self._stopped, self._shown_s = False, time.monotonic()

    def run(self) -> None:
        """All of them, several at a time; what is whole stays if one fails."""
        with ThreadPoolExecutor(AT_ONCE) as pool:
            try:
                for first in range(0, len(self._files), PART):
                    for done, _ in enumerate(pool.map(self._fetch, self._files[first : first + PART]), first + 1):
                        self._show(done)
            finally:
                self._stopped = True  # those that are at work would go on for long
                pool.shutdown(cancel_futures=True)

    def _fetch(self, file: RemoteFile) -> None:
        place = _place(self._copy, file)
        place.parent.mkdir(parents=True, exist_ok=True)
        aside = self._copy.parent / f"{hashlib.sha256(file.name.encode()).hexdigest()[:16]}.file"
        write_whole(aside, lambda out: self._read(file, out))
        aside.replace(place)

    def _read(self, file: RemoteFile, out: BinaryIO) -> None:
        left = file.size
        with self._store.open(file.path, "rb") as source:
            while chunk := source.read(CHUNK):
                left -= len(chunk)
                if left < 0 or self._stopped:
                    break
                out.write(chunk)
                self._bytes += len(chunk)  # shown alone: threads may overtake each other here
                self._show(None)
        if left:
            raise DataError(f"{self._url}: {file.path} has not the {file.size} bytes that were listed; run it again")

    def _show(self, done: int | None) -> None:
        """A line now and then."""
        if time.monotonic() - self._shown_s > SHOWN_S:
            self._shown_s = time.monotonic()
            files = "" if done is None or len(self._files) == 1 else f", {done} of {len(self._files)} files"
            print_error(f"fetched: {size(self._bytes)} of {size(self._total)}{files}")


def _store(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path there. It remembers nothing: neither connections nor what was listed."""
    options: dict[str, Any] = {"skip_instance_cache": True, "use_listings_cache": False}
    if protocol_of(url) in {"http", "https"}:
        timeout = aiohttp.ClientTimeout(total=None, sock_connect=SILENCE_S, sock_read=SILENCE_S)
        options["client_kwargs"] = {"timeout": timeout, "trust_env": True}  # of proxies
    store, path = fsspec.core.url_to_fs(url, **options)
    return store, str(path)


def _place(copy: Path, file: RemoteFile) -> Path:
    return copy / file.name if file.name else copy


def _lacking(copy: Path, files: Sequence[RemoteFile]) -> list[RemoteFile]:
    """The files that are not there, or not whole."""
    return [file for file in files if _size(_place(copy, file)) != file.size]


def _size(file: Path) -> int | None:
    try:
        return file.stat(follow_symlinks=False).st_size
    except (FileNotFoundError, NotADirectoryError):
        return None


def _bytes(files: Sequence[RemoteFile]) -> int:
    return sum(file.size for file in files)


def _amount(files: Sequence[RemoteFile]) -> str:
    return f"{size(_bytes(files))} in {len(files)} file{'s' if len(files) > 1 else ''}"


def _check_room(name: str, url: str, files: Sequence[RemoteFile], folder: Path, limits: Limits) -> None:
    """ConfigError if all copies would take more than the cache may hold, or than the disk has free."""
    held = sum(_size(path) or 0 for path in folder.rglob("*") if path.is_file())
    needed = held + _bytes(files)
    if needed > limits.gb * 1e9:
        others = f", {folder} holds {size(held)} of others" if held else ""
        remove = ", or remove what is no longer needed there" if held else ""
        raise ConfigError(
            f"{name}={url} has {_amount(files)}{others}, and cache_gb={limits.gb:g} is the most; give"
            f" cache_gb={-(-needed // 10**9)}{remove}"
        )
    if limits.disk:
        check_work(f"copies of {url}", "make room there, or give another cache=DIR", disk=_bytes(files), folder=folder)


@contextmanager
def _alone(folder: Path, url: str) -> Iterator[None]:
    """No other process fetches into this folder meanwhile."""
    with (folder / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print_error(f"another process fetches {url}; this one waits for it")
            fcntl.flock(lock, fcntl.LOCK_EX)
        except OSError:  # a disk without locks: then both may fetch, and either's files are whole
            pass
        yield


@contextmanager
def _in_sentences(name: str, url: str, folder: Path) -> Iterator[None]:
    """What stores and their libraries raise, as a DataError."""
    try:
        yield
    except OmnilabError:
        raise
    except OSError as error:
        if isinstance(error.filename, str | Path) and Path(error.filename).is_relative_to(folder):
            raise DataError(
                f"{error.filename} cannot be written ({error.strerror}); mend that, or give another cache=DIR"
            ) from error
        raise _of_store(name, url, error) from error
    except Exception as error:  # each store's library has its own
        raise _of_store(name, url, error) from error


def _of_store(name: str, url: str, error: Exception) -> OmnilabError:
    """The sentence about what a store, or its library, raised."""
    if mistake := of_machine(error):
        return mistake
    if isinstance(error, ImportError):  # fsspec says what to install
        return ConfigError(f"{name}={url}: {error}; pip install 'omnilab[storage]' has what s3, gs and https need")
    if isinstance(error, FileNotFoundError):
        return DataError(f"{name}={url}: there is nothing of this name; correct it")
    if isinstance(error, PermissionError):
        return DataError(f"{name}={url} may not be read with the credentials that are set here; see docs/clusters.md")
    why = re.sub(r"\w+://\S+", "...", f"{type(error).__name__}: {error}")  # which may be signed
    return DataError(f"{name}={url} cannot be fetched ({why[:500]}); mend that, or fetch it yourself")
