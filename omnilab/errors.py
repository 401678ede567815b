"""Errors in the user's input, data or plugins. The command line shows these as one sentence and ends with exit code 2."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class OmnilabError(Exception):
    """A mistake of the user, the data or the machine, in one sentence that ends with what fixes it."""


class ConfigError(OmnilabError):
    """A value in the configuration cannot be used."""


class DataError(OmnilabError):
    """Images, positions, worlds or logs are not as expected."""


class PluginError(OmnilabError):
    """A plugin does not keep the contract."""

    item: int | None = None  # which of the images, queries, ... of a batch it is about


def did_you_mean(word: str, known: Iterable[str], prefix: str = "") -> str:
    """A suggestion in brackets, or nothing."""
    close = difflib.get_close_matches(word, list(known), n=1)
    return f" (did you mean {prefix}{close[0]}?)" if close else ""


def visible(text: str) -> str:
    """The text with what a terminal would obey, or not show, as escapes: names of files and overrides are data."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text)
