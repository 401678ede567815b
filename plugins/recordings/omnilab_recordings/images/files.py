"""Image files: which there are below a folder, and their content."""

from __future__ import annotations

import os
import unicodedata
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab_recordings.images.order import in_order

SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"})
LARGEST_FILE = 256 * 2**20  # bytes
MOST_FILES = 1_000_000  # below a folder; a link to a whole disk is a mistake


def image_names(folder: Path, pattern: str) -> list[str]:
    """Paths below the folder of the images that match a glob pattern, in the order of `in_order`.

    What is hidden (its name starts with a dot) is no image. Links to folders are followed.
    """
    parts = PurePosixPath(composed(pattern)).parts
    names = (file.relative_to(folder).as_posix() for file in _files(folder) if file.suffix.lower() in SUFFIXES)
    return in_order(name for name in names if _matches(composed(name).split("/"), parts))


def composed(name: str) -> str:
    """A name in Unicode's composed form (NFC), in which names of systems that decompose them (NFD) compare equal."""
    return unicodedata.normalize("NFC", name)


def as_on_disk(named: Iterable[str], found: Sequence[str]) -> list[str]:
    """Names as the files have them, where these are the same but for Unicode's forms; others as they are."""
    there, other_form = set(found), {composed(name): name for name in found}
    return [name if name in there else other_form.get(composed(name), name) for name in named]


def existing(path: Path) -> Path:
    """The path, its parts as they are on disk where these are the same but for Unicode's forms."""
    try:
        if path.exists() or path.parent == path:
            return path
        parent = existing(path.parent)
        same = (other for other in parent.iterdir() if composed(other.name) == composed(path.name))
        return next(same, parent / path.name)
    except OSError:
        return path


def _files(folder: Path) -> Iterator[Path]:
    """Every file below the folder that is not hidden, once: its own path before those that lead through links."""
    count, walked, tops = 0, set[tuple[int, int]](), deque([folder])
    while tops:
        for at, folders, files in os.walk(tops.popleft()):
            here = Path(at).stat()
            if (here.st_dev, here.st_ino) in walked:
                folders.clear()
                continue
            walked.add((here.st_dev, here.st_ino))
            folders[:] = [name for name in folders if not name.startswith(".")]
            tops += [link for name in folders if (link := Path(at, name)).is_symlink() and not _holds(link, folder)]
            count += len(files)
            if count > MOST_FILES:
                raise DataError(
                    f"{folder} holds more than {MOST_FILES} files; give sensor.path=DIR, a folder of images"
                )
            yield from (Path(at, name) for name in files if not name.startswith("."))


def _holds(link: Path, folder: Path) -> bool:
    """Whether a link leads back to where the folder itself lies."""
    return folder.resolve().is_relative_to(link.resolve())


def _matches(name: Sequence[str], pattern: Sequence[str]) -> bool:
    """As `Path.glob` has it: `**` is any number of folders, other wildcards stay within a name."""
    if not pattern:
        return not name
    if pattern[0] == "**":
        return len(pattern) > 1 and (_matches(name, pattern[1:]) or (len(name) > 1 and _matches(name[1:], pattern)))
    return bool(name) and fnmatchcase(name[0], pattern[0]) and _matches(name[1:], pattern[1:])


def read_bytes(folder: Path, name: str) -> bytes:
    """The content of a file below the folder; DataError if it cannot be read or is too large for an image."""
    file = existing(folder / name)
    try:
        return content_of(file, LARGEST_FILE)
    except OSError as error:
        raise DataError(f"{name} cannot be read ({error.strerror})") from error
