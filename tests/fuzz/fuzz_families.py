"""Families of inputs, by name: each makes a folder once, and then makes and uses an input from its seed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import fuzz_formats
from fuzz_formats import Format
from fuzz_more_formats import ALL
from fuzz_runs import BASES, runs
from fuzz_settings import Constructed

Use = Callable[[str], None]

cv2.setNumThreads(1)


def _format(how: Format, folder: Path) -> Use:
    sound = how.prepare(folder)
    how.read(folder)  # imports, compiles, fills caches; and it must be sound
    return partial(how.fuzz, folder, sound)


FAMILIES: dict[str, Callable[[Path], Use]] = {
    **{name: partial(_format, how) for name, how in ALL.items()},
    "settings": Constructed,
    **{f"runs_{name}": runs(name) for name in BASES},
}
SLOW = fuzz_formats.SLOW | {f"runs_{name}" for name in BASES}  # a tenth of a second and more for each input
