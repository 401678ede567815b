"""What `omnilab check` finds about how pictures are read: pages, orientation, bits, transparency; mirrors or panoramas."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

from omnilab.cameras import ImageCircle
from omnilab_recordings import remarks
from omnilab_recordings.checks.dataset_check import CheckedFile, Finding
from omnilab_recordings.folder import Folder
from omnilab_recordings.optics import most_alike
from omnilab_recordings.panoramas import proposed


def of_reading(sensor: Folder, files: Sequence[CheckedFile]) -> Iterator[Finding]:
    """What of the files is read otherwise than a user may think."""
    good = [file for file in files if not file.error]
    counts = Counter(topic for file in good for topic in file.remarks)
    for topic, sentence in remarks.of_files({file.name: file.remarks for file in good}).items():
        yield Finding(topic, "look", f"{sentence} ({counts[topic]} of {len(good)})")
    if (mixed := remarks.of_depths({file.name: file.deep for file in good})) is not None:
        yield Finding("depth maps", "look", mixed)
    if (dark := sensor.remarks.get("bits")) is not None:
        yield Finding("bits", "look", dark)


def as_panorama(sensor: Folder) -> tuple[Folder, Finding | None]:
    """The sensor, taking pictures for panoramas where they close on themselves as these do; what is found, if not as given."""
    sentence = sensor.remarks.get("panorama")
    if sentence is None:
        return sensor, None
    kind, closed = proposed(most_alike(sensor.sample))
    if kind is None or not closed or not isinstance(sensor.optics.camera, ImageCircle):
        return sensor, Finding("panorama", "?", sentence)
    text = f"{sentence}; they are checked as panoramas, as with --panorama {kind.value}"
    return replace(sensor, panorama=kind, circle_px=None, sky_inside=False), Finding("panorama", "look", text)
