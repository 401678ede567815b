"""One fuzzed input: made from its number alone, used as a user would, with an outcome that holds or not."""

from __future__ import annotations

import re
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from omnilab.errors import OmnilabError

SECONDS = 20  # for one input, of which most take milliseconds
LONGEST = 2500  # characters of a sentence


class Hang(BaseException):
    """An input took too long."""


class Broken(Exception):
    """A result that an invariant does not confirm, or a sentence that is none."""


@dataclass(frozen=True)
class Outcome:
    """What became of an input: `ok`, `refused` or `failed`, and the sentence or traceback."""

    verdict: str
    text: str = ""


def outcome_of(use: Callable[[], Any], seconds: int = SECONDS) -> Outcome:
    """Run something that ends well, or in an OmnilabError of one sentence; anything else has failed."""
    try:
        with alarm(seconds), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            use()
    except OmnilabError as error:
        return _judged(str(error))
    except Hang:
        return Outcome("failed", f"hang: not ended after {seconds} s\n{traceback.format_exc()}")
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return Outcome("failed", traceback.format_exc())
    return Outcome("ok")


def _judged(sentence: str) -> Outcome:
    wrong = ""
    if not sentence.strip():
        wrong = "an empty sentence"
    elif "\n" in sentence.strip():
        wrong = "more than one line"
    elif len(sentence) > LONGEST:
        wrong = "longer than a screen"
    elif re.search(r"Traceback|<[\w.]+ object at 0x", sentence):
        wrong = "what Python says"
    return Outcome("failed", f"{wrong}: {sentence[:3000]}") if wrong else Outcome("refused", sentence)


@contextmanager
def alarm(seconds: int) -> Iterator[None]:
    """Raise `Hang` after so many seconds, where Python code runs."""

    def ring(*_: Any) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def confirm(condition: Any, what: str) -> None:
    """Broken unless an invariant holds."""
    if not condition:
        raise Broken(what)
