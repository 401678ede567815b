"""Times of images and times of a file of poses: whether they can be of one clock, and in which unit they are."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from omnilab.api import Ints

SECONDS_OF_TODAY = (10**9, 4 * 10**9)  # times within are taken to be seconds since 1970: 2001 to 2096
UNITS = {10**9: "nanoseconds", 10**6: "microseconds", 10**3: "milliseconds"}  # in how many a second is divided
MOST_TIMES_LONGER = 300  # a file than images, or images than a file, of one recording
SELDOM_S = 5.0  # no wheels tell so seldom
DIGITS = {19: 1, 16: 10**3, 13: 10**6}  # of whole numbers that are times since 1970: nanoseconds of their unit


def span(stamps_ns: Ints) -> str:
    """From when to when, in seconds, and in dates where these are of the years after 2001."""
    first, last = int(stamps_ns.min()), int(stamps_ns.max())
    return _time(first) if first == last else f"{_time(first)} to {_time(last)}"


def _time(stamp_ns: int) -> str:
    seconds = f"{stamp_ns / 10**9:.3f} s"
    if not _of_today(np.array([stamp_ns])):
        return seconds
    return f"{seconds} ({datetime.fromtimestamp(stamp_ns // 10**9, UTC):%Y-%m-%d %H:%M:%S} UTC)"


def overlap(one_ns: Ints, other_ns: Ints) -> bool:
    """Whether two spans of time have anything in common."""
    return bool(one_ns.min() <= other_ns.max() and other_ns.min() <= one_ns.max())


def _alike(one_ns: Ints, other_ns: Ints) -> bool:
    """Whether two spans have anything in common, and are about as long: 0 s, where videos begin, lies near any small number."""
    lengths = sorted(max(int(np.ptp(stamps)), 1) for stamps in (one_ns, other_ns))
    return overlap(one_ns, other_ns) and lengths[1] <= MOST_TIMES_LONGER * lengths[0]


def differ(
    images_ns: Ints, file_ns: Ints, file: str, name: str = "the images were taken at", shifted: str | None = None
) -> str:
    """Both spans, and which unit or shift would bring them together, of times that have nothing in common.

    `shifted`: what shifts them; None: mending the file does.
    """
    return f"{name} {span(images_ns)}, and {file} covers {span(file_ns)}; {_remedy(images_ns, file_ns, file, shifted)}"


def _remedy(images_ns: Ints, file_ns: Ints, file: str, shifted: str | None) -> str:
    for factor, unit in UNITS.items():
        if not _of_today(file_ns) and _alike(images_ns, file_ns // factor):
            return f"the times in {file} look like {unit} where seconds belong: divide them by {factor}"
        if not _of_today(images_ns) and _alike(images_ns // factor, file_ns):
            return f"the times of the images look like {unit} where seconds belong: divide them by {factor}"
    if shifted is not None:
        return f"these are two clocks: {shifted}, or take the file of this recording"
    shift = (int(images_ns.min()) - int(file_ns.min())) / 10**9
    return (
        f"these are two clocks: add what lies between them to the times in {file}"
        f" (about {shift:.3f} s, if both begin together), or take the file of this recording"
    )


def _of_today(stamps_ns: Ints) -> bool:
    """Whether times are seconds since 1970, of the years after 2001, as they stand."""
    return SECONDS_OF_TODAY[0] <= int(stamps_ns.min()) / 10**9 <= SECONDS_OF_TODAY[1]


def unit_of(seconds: float) -> str | None:
    """The unit that a time since 1970 is in, if it is no second of the years after 2001."""
    found = (unit for factor, unit in UNITS.items() if SECONDS_OF_TODAY[0] <= seconds / factor <= SECONDS_OF_TODAY[1])
    return next(found, None)


def about_seldom(stamps_ns: Ints) -> str | None:
    """The question whether times (N,) between which a robot's pose is interpolated are in another unit than seconds."""
    apart = float(np.median(np.diff(stamps_ns))) / 10**9 if len(stamps_ns) > 1 else 0.0
    if apart < SELDOM_S:
        return None
    return (
        f"its poses are {apart:.4g} s apart, and what lies between is interpolated; if its times are in milliseconds (stamp_ms in"
        " a CSV) or microseconds (stamp_us), divide them to seconds"
    )


def stamps_of_names(names: list[str]) -> Ints | None:
    """Times (N,) in nanoseconds that whole numbers as names give, by how many digits they have; None if they do not."""
    lengths = {len(name) for name in names if name.isascii() and name.isdigit()}
    if len(lengths) != 1 or not all(name.isascii() and name.isdigit() for name in names):
        return None
    (digits,) = lengths
    return None if digits not in DIGITS else np.array([int(name) * DIGITS[digits] for name in names], np.int64)
