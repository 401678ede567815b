"""A run's pictures within a page, as data: addresses; bounded, and none but PNG."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from omnilab_serve.run_details.details import figure_title
from omnilab_serve.run_details.files import PNG, open_file

LARGEST, MOST_BYTES = 8 << 20, 32 << 20  # of a picture, of all in a report


@dataclass(frozen=True)
class ReportPicture:
    """A picture within the report, or why it is not."""

    title: str
    address: str = ""  # data:image/png...
    why_not: str = ""


class PictureBudget:
    """Takes pictures into a report while there is room."""

    def __init__(self) -> None:
        self._left = MOST_BYTES

    def pictures(self, folder: Path, names: Iterable[str]) -> Iterator[ReportPicture]:
        """Those of a run's folder, by the names of their files."""
        for name in names:
            yield self._picture(folder / name)

    def _picture(self, file: Path) -> ReportPicture:
        title = figure_title(file.name)
        try:
            with open_file(file) as stream:
                content = stream.read(LARGEST + 1) or b""
        except OSError as error:
            return ReportPicture(title, why_not=f"{file.name} cannot be read ({error.strerror})")
        if not content.startswith(PNG):
            return ReportPicture(title, why_not=f"{file.name} is no PNG")
        if len(content) > min(LARGEST, self._left):
            return ReportPicture(title, why_not=f"{file.name} is too large for a report; it is in {file.parent}")
        self._left -= len(content)
        return ReportPicture(title, f"data:image/png;base64,{base64.b64encode(content).decode()}")
