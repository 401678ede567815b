"""The files and folders that settings name: their digests, and whether those of a saved configuration may be opened.

A configuration out of a file may be a stranger's, and name any file of the caller's. One that is known by its digest is
no secret to whoever wrote the configuration, and it is the file that was read then.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, ListConfig, OmegaConf

from omnilab.file_kinds import opened
from omnilab.runner.storage.urls import is_url

LARGEST_FILE = 2**34  # bytes: sparse files have any size and take no space
MOST_FILES = 1_000_000  # of a folder
SHOWN = 5  # files in a sentence


def file_digests(path: str, settings: Any) -> dict[str, str]:
    """The SHA-256 of every file that a setting names, by the setting's path; of a folder, of its files' names and sizes.

    What is no regular file and no folder has none, nor what is too large to be read.
    """
    aside = _folder_of_runs(settings)
    found = {name: _digest(place, aside) for name, place in inputs_of(path, settings)}
    return {name: digest for name, digest in found.items() if digest is not None}


def unknown_inputs(path: str, settings: Any, known: Mapping[str, str], aside: Iterable[str] = ()) -> list[str]:
    """Which settings name a file or folder that is there without the known digest, as `setting=value`.

    So does what leads out of the working folder to where a file could be made. `aside`: folders of runs.
    """
    folders = {os.path.realpath(folder) for folder in aside}
    return [
        f"{name}={place}"
        for name, place in inputs_of(path, settings)
        if name not in known or _digest(place, folders) != known[name]
    ]


def listed(inputs: list[str]) -> str:
    """Settings and their files for a sentence, the first of them."""
    return ", ".join(inputs[:SHOWN]) + (", ..." if len(inputs) > SHOWN else "")


def leaves(path: str, settings: Any) -> Iterator[tuple[str, Any]]:
    """Every value in nested settings, with its path; none of those that name what is written."""
    members = _members(settings)
    if members is None:
        yield path, settings
    for name, value in members or ():
        yield from leaves(f"{path}.{name}".removeprefix("."), value)


def names_folder(value: Any) -> bool:
    """Whether a value is the path of a folder."""
    return _is_text(value) and os.path.isdir(value)


def _members(settings: Any) -> list[tuple[str, Any]] | None:
    """The members of settings, if they have any."""
    cls = OmegaConf.get_type(settings) if isinstance(settings, DictConfig) else type(settings)
    written = {f.name for f in fields(cls) if "writes" in f.metadata} if is_dataclass(cls) else set()
    if isinstance(settings, DictConfig):
        there = [key for key in settings if not OmegaConf.is_missing(settings, key)]
        return [(str(key), settings[key]) for key in there if key not in written]
    if is_dataclass(settings):
        return [(f.name, getattr(settings, f.name)) for f in fields(settings) if f.name not in written]
    if isinstance(settings, Mapping):
        return [(str(key), value) for key, value in settings.items()]
    if isinstance(settings, list | ListConfig):
        return [(str(i), value) for i, value in enumerate(settings)]
    return None


def inputs_of(path: str, settings: Any, folders: Iterable[tuple[str, str]] = ()) -> Iterator[tuple[str, str]]:
    """Every place on the disk that a setting names, and every URL, with the setting's path.

    A text may be meant from the working folder, or from a folder that another setting beside it names; what lies within
    that one belongs to it.
    """
    members = _members(settings)
    if members is None:
        if _is_text(settings):
            place = os.path.expanduser(settings)
            if os.path.lexists(place) or _leads_out(place) or is_url(settings):
                yield path, place
            for name, folder in folders:
                below = os.path.join(folder, place)
                if (
                    name != path
                    and not os.path.isabs(place)
                    and os.path.lexists(below)
                    and not _is_below(below, folder)
                ):
                    yield f"{path} below {name}", below
        return
    named = [(f"{path}.{name}".removeprefix("."), value) for name, value in members]
    beside = [(name, str(value)) for name, value in named if names_folder(value)]
    for name, value in named:
        yield from inputs_of(name, value, beside)


def _is_text(value: Any) -> bool:
    """Whether a value may be a path."""
    return isinstance(value, str | Path) and str(value) != ""


def _leads_out(place: str) -> bool:
    """Whether it lies outside the working folder, where a file of its name could be made."""
    parent = os.path.dirname(place.rstrip("/"))
    outside = os.path.isabs(place) or ".." in place.split("/")
    return outside and parent != "/" and os.path.isdir(parent)


def _is_below(place: str, folder: str) -> bool:
    return Path(os.path.realpath(place)).is_relative_to(os.path.realpath(folder))


def _folder_of_runs(settings: Any) -> set[str]:
    """Where the runs go that have these settings: in a folder that is read, they change with every run."""
    logs = getattr(settings, "logs", None)
    return {os.path.realpath(logs)} if isinstance(logs, str) else set()


def _digest(place: str, aside: Collection[str]) -> str | None:
    try:
        return _listing(place, aside) if os.path.isdir(place) else _content(place)
    except OSError:
        return None


def _content(file: str) -> str:
    with opened(Path(file), LARGEST_FILE) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _listing(folder: str, aside: Collection[str]) -> str | None:
    """Of a folder: of the names and sizes of all that it holds, links as they are, what is hidden left out."""
    lines: list[str] = []
    for at, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if os.path.realpath(os.path.join(at, name)) not in aside]
        links = [name for name in folders if os.path.islink(os.path.join(at, name))]
        folders[:] = [name for name in folders if name[:1] != "."]
        for name in (name for name in [*files, *links] if name[:1] != "."):
            path = os.path.join(at, name)
            lines.append(f"{path[len(folder) :].lstrip('/')} {os.lstat(path).st_size}")
        if len(lines) > MOST_FILES:
            return None
    return hashlib.sha256("\n".join(sorted(lines)).encode(errors="surrogateescape")).hexdigest()
