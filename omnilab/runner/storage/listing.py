"""What lies under a URL: names, sizes and versions, as the store says them; nothing that could be written elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from omnilab.errors import DataError
from omnilab.runner.input_files import MOST_FILES
from omnilab.runner.storage.urls import is_name

TAGS = (  # what tells one version of an object from another, by the names that stores give it
    "ETag", "etag", "md5Hash", "crc32c", "generation", "Content-MD5", "Digest", "LastModified", "Last-Modified", "updated",
    "last_modified", "mtime", "created",
)  # fmt: skip


class RemoteFile(NamedTuple):
    """An object of a store."""

    name: str  # its path below the URL, with slashes; "" of the one that the URL names itself
    path: str  # as the store has it
    size: int  # bytes
    tag: str  # of its version


def listing(store: Any, path: str, url: str) -> list[RemoteFile]:
    """The object of a path, or all below it, by name. `store`: a file system of fsspec.

    DataError for more than are read, for a name that leads elsewhere, and where the store does not say which version it is.
    FileNotFoundError if there is nothing.
    """
    about = store.info(path)
    if about["type"] != "directory":
        return [_file("", about, url)]
    found: list[RemoteFile] = []
    for _, _, files in store.walk(path, detail=True, on_error="raise"):
        named = [each for each in files.values() if not each["name"].endswith("/")]  # but marks of empty folders
        found += [_file(_below(path, each["name"], url), each, url) for each in named]
        if len(found) > MOST_FILES:
            raise DataError(f"{url} holds more than {MOST_FILES} files; name a folder within it")
    if not found:
        raise FileNotFoundError(path)
    return sorted(found)


def _below(folder: str, path: str, url: str) -> str:
    """The name of an object below a folder; DataError if a copy by that name would be written elsewhere."""
    root = folder.rstrip("/") + "/"
    name = path.removeprefix(root)
    if not path.startswith(root) or not all(map(is_name, name.split("/"))):
        raise DataError(f"{url} holds {path!r}, which is no name of a file below it; rename that there")
    return name


def _file(name: str, about: Mapping[str, Any], url: str) -> RemoteFile:
    size, tags = about.get("size"), [f"{tag}={about[tag]}" for tag in TAGS if about.get(tag)]
    if not isinstance(size, int) or size < 0 or not tags:
        raise DataError(
            f"{url}: its server says of {about['name']} no {'size' if tags else 'version (ETag, Last-Modified)'}, so a copy"
            " might be stale; fetch it yourself and give its path"
        )
    return RemoteFile(name, str(about["name"]), size, " ".join(tags))
