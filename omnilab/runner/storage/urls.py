"""URLs in settings: which are inputs, which protocols are taken, and that none holds a secret.

Settings are kept in logs, manifests and plans of sweeps, so a URL with a password or a signature is refused before any of
these is written. Credentials are the business of the store's own library: its environment variables and files.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from typing import Any
from urllib.parse import unquote

from omnilab.errors import ConfigError

PROTOCOLS = ("s3", "gs", "https", "file")
VARIABLE = "OMNILAB_STORAGE"  # further ones, with commas; no configuration can set it
LONGEST_NAME = 255  # bytes
URL = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://(.*)", re.DOTALL)
WITHIN = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://[^\s,'\"\])}]*")  # in the word of a command, which may be a list


def is_url(value: Any) -> bool:
    """Whether a setting's value is a URL rather than a path."""
    return isinstance(value, str) and URL.fullmatch(value) is not None


def protocol_of(url: str) -> str:
    """What stands before `://`, in lower case."""
    return url.partition("://")[0].lower()


def protocols() -> tuple[str, ...]:
    """All protocols that are taken."""
    return PROTOCOLS + tuple(filter(None, (word.strip().lower() for word in os.environ.get(VARIABLE, "").split(","))))


def shown(url: str) -> str:
    """A URL without what may be secret, for sentences."""
    protocol, _, rest = re.split(r"[?#]", url, maxsplit=1)[0].partition("://")
    authority, slash, path = rest.partition("/")
    return f"{protocol}://{authority.rpartition('@')[2]}{slash}{path}"


def check(name: str, url: str) -> None:
    """ConfigError for the URL of a setting that is not taken."""
    _refuse_secrets(name, url)
    protocol = protocol_of(url)
    if protocol not in protocols():
        raise ConfigError(
            f"{name}={url} has the protocol {protocol}, and {', '.join(protocols())} are taken; give one of those, a local"
            f" path, or allow another that fsspec knows: {VARIABLE}={protocol} omnilab ..."
        )
    if "::" in url or not is_name(last_name(url)):
        raise ConfigError(f"{name}={url} names no file or folder; give a URL such as s3://BUCKET/FOLDER")


def refuse_secrets(words: Iterable[str]) -> None:
    """ConfigError if a word of a command has a URL of a store with a password or a signature: words are written down."""
    for word in words:
        for url in WITHIN.findall(word):
            if protocol_of(url) in protocols():
                _refuse_secrets(word.partition("=")[0], url)


def local_path(url: str) -> str:
    """The path that a `file://` URL names; ConfigError if that is on another machine."""
    host, slash, path = url.partition("://")[2].partition("/")
    if host not in {"", "localhost"}:
        raise ConfigError(f"{url} names the machine {host}; give file:///FOLDER, with three slashes, or a path")
    return unquote(slash + path)


def last_name(url: str) -> str:
    """The name of what a URL names, for its copy."""
    return url.rstrip("/").rpartition("/")[2]


def is_name(name: str) -> bool:
    """Whether a file may be called so, in the folder that it is meant for."""
    return name not in {"", ".", ".."} and not set("/\\\0") & set(name) and len(name.encode()) <= LONGEST_NAME


def _refuse_secrets(name: str, url: str) -> None:
    if "@" in url.partition("://")[2].partition("/")[0]:
        raise ConfigError(
            f"{name}={shown(url)} came with a user or a password, which would be kept in logs; leave them out, and give them"
            " where the store's library looks for them (docs/clusters.md)"
        )
    if set("?#") & set(url):
        raise ConfigError(
            f"{name}={shown(url)} came with a query (?...), which may be a signature and would be kept in logs; leave it out,"
            " or fetch the file yourself and give its path"
        )
