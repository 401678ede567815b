"""What a user should know of how the files of a folder are read: logged once by a run, listed by `omnilab check`."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath

from omnilab_recordings.images.decoding import DecodedImage
from omnilab_recordings.images.headers import FULL

log = logging.getLogger("omnilab")

SHOWN = 3  # files in a sentence
DARK = 2**14  # of samples of 16 bits: if none is as large, the camera has fewer bits, or the pictures are dark
BITS = (8, 10, 12, 14)  # that cameras have
TEXTS = {
    "pages": "of images with several pages or frames only the first is read",
    "transparency": "what is transparent in images is read as black",
    "damage": "images may be damaged, their JPEG data have bytes that belong to no pixel: look at them, or replace the files",
    "orientation": "images are turned as their EXIF tags say, as viewers show them; of a camera that looks up or down tags are"
    " but guesses, and sensor.exif_orientation=false takes the pixels as stored",
}


class RemarkLog:
    """Logs the remarks on a recording, each topic once."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._logged: set[str] = set()

    def warn(self, remarks: Mapping[str, str]) -> None:
        """Log what was not logged before: sentences, by topic."""
        for topic, sentence in remarks.items():
            if topic not in self._logged:
                log.warning("%s: %s", self._path, sentence)
                self._logged.add(topic)


def of_file(image: DecodedImage, exif_orientation: bool) -> dict[str, str]:
    """Topics of `TEXTS` that a file gives rise to, each with what is particular to it."""
    found = {}
    if image.header.pages > 1:
        found["pages"] = f"{image.header.pages} pages"
    if image.transparent:
        found["transparency"] = ""
    if image.stray_bytes:
        found["damage"] = ""
    if exif_orientation and image.header.orientation > 1:
        found["orientation"] = f"tag {image.header.orientation}"
    return found


def of_files(images: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """A sentence a topic, from what `of_file` found in files, by name."""
    return {
        topic: f"{text}: {_examples({name: found[topic] for name, found in images.items() if topic in found})}"
        for topic, text in TEXTS.items()
        if any(topic in found for found in images.values())
    }


def _examples(particular: Mapping[str, str]) -> str:
    """The first file of each particular, such as each orientation, and whether there are more."""
    first: dict[str, str] = {}
    for name, what in particular.items():
        first.setdefault(what, name)
    names = [f"{name} ({what})" if what else name for what, name in sorted(first.items())][:SHOWN]
    return ", ".join(names) + (", ..." if len(particular) > len(names) else "")


def of_range(images: Sequence[DecodedImage], bits: int | None) -> str | None:
    """Whether images of 16 bits use but a small part of them."""
    deep = [image for image in images if image.header.bits == 16 and image.header.largest == FULL]
    peak = max((image.peak for image in deep), default=FULL)
    if bits is not None or peak >= DARK:
        return None
    used = next(bits for bits in BITS if peak < 2**bits)
    return (
        f"images of 16 bits a sample have none above {peak} (white is {FULL}) and come out dark, with grey levels up to"
        f" {peak >> 8}: if the camera has {used} bits, give sensor.bits={used}"
    )


def of_depths(deep_images: Mapping[str, bool]) -> str | None:
    """Whether images of 16 bits, as depth maps are, lie among others of 8."""
    deep, plain = ([name for name, is_deep in deep_images.items() if is_deep is wanted] for wanted in (True, False))
    if not deep or not plain:
        return None
    pattern = _pattern(plain, deep)
    remedy = f"give sensor.pattern={pattern}" if pattern else "narrow sensor.pattern to one kind alone"
    return f"{deep[0]} has 16 bits a sample, as depth maps do, and {plain[0]} has 8: {remedy}"


def _pattern(wanted: Sequence[str], others: Sequence[str]) -> str | None:
    """A pattern that takes the wanted files and none of the others: those of one folder, or of one ending."""
    for by_folder in (True, False):
        mine, theirs = (
            {f"{file.parent}/*" if by_folder else f"**/*{file.suffix}" for file in map(PurePosixPath, names)}
            for names in (wanted, others)
        )
        (pattern, *more) = mine
        if not more and pattern not in theirs and re.fullmatch(r"[\w./*-]+", pattern, re.ASCII):
            return pattern.removeprefix("./")
    return None
