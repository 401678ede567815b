"""Errors in the user's input, data or plugins. The command line shows these as one sentence and ends with exit code 2."""

from __future__ import annotations

import difflib
import errno
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


UNWRITABLE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO}


def of_machine(error: BaseException) -> OmnilabError | None:
    """The sentence about a full disk, too little memory or too many files, which are no bugs; None about another error."""
    if isinstance(error, OSError) and error.errno in UNWRITABLE:
        what = error.filename or "a file"
        return DataError(f"{what} cannot be written ({error.strerror}); make room there, or give another place")
    if isinstance(error, OSError) and error.errno in {errno.EMFILE, errno.ENFILE}:
        return DataError(f"no more files can be opened ({error.strerror}); give a larger limit first: ulimit -n 4096")
    if isinstance(error, MemoryError):
        why = f" ({error})" if str(error) else ""
        return DataError(f"there is too little memory{why}; give it less to do at once, or a larger machine")
    return None


def did_you_mean(word: str, known: Iterable[str], prefix: str = "") -> str:
    """A suggestion in brackets, or nothing."""
    close = difflib.get_close_matches(word, list(known), n=1)
    return f" (did you mean {prefix}{close[0]}?)" if close else ""


def with_article(noun: str) -> str:
    """A noun in the singular after its article: an odometry."""
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def visible(text: str) -> str:
    """The text with what a terminal would obey, or not show, as escapes: names of files and overrides are data."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text)
