"""Conversion of a copy of a published data set to the documented folder: images, and positions.csv or truth.csv."""

from __future__ import annotations

import csv
import hashlib
import io
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from omnilab.api import Floats
from omnilab.atomic_files import write_whole
from omnilab.errors import ConfigError, DataError
from omnilab.file_kinds import content_of
from omnilab_recordings.images.order import in_order
from omnilab_recordings.published.published_set import Conversion, ExpectedFiles, Form, PublishedSet
from omnilab_recordings.published.zind import SCALE, tour_of

LARGEST_TABLE = 2**28  # bytes
LARGEST_DIGESTED = 2**30
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "m": 1.0, "cm": 1e-2, "mm": 1e-3}
DONE = "prepared.txt"  # written last: what became of what


@dataclass(frozen=True)
class Row:
    """One image of a drive."""

    source: Path
    x_m: float
    y_m: float
    stamp_s: float | None = None
    heading: tuple[str, str] | None = None  # column and text
    z_m: float | None = None
    name: str | None = None  # below the folder of images; None: the source's own, or a number


def problems(form: Form, folder: Path) -> list[str]:
    """What a copy in a folder lacks of a form, in sentences; none: it is whole."""
    return [sentence for expected in form.files if (sentence := _problem(expected, folder))]


def _problem(expected: ExpectedFiles, folder: Path) -> str | None:
    found = sum(1 for path in folder.glob(expected.glob) if path.is_file())
    if expected.sha256 is not None and found == 1:
        file = next(iter(folder.glob(expected.glob)))
        if hashlib.sha256(content_of(file, LARGEST_DIGESTED)).hexdigest() != expected.sha256:
            return f"{expected.glob} has another content than the published file"
    if expected.count is None:
        return None if found else f"{expected.glob}: none is there"
    return None if found == expected.count else f"{expected.glob}: {found} of {expected.count} are there"


def form_of(published: PublishedSet, folder: Path) -> tuple[Form, list[str]]:
    """The form that a copy is nearest to, and what it lacks of that; DataError for sets without a conversion."""
    if not folder.is_dir():
        raise DataError(
            f"the folder {folder} does not exist; download the set ({published.where}) and give where it is"
        )
    if not published.forms:
        raise DataError(f"{published.name} has no conversion here; {published.notes or 'see omnilab dataset list'}")
    return min(
        ((form, problems(form, folder)) for form in published.forms), key=lambda pair: len(pair[1]) / len(pair[0].files)
    )


def prepare(published: PublishedSet, folder: Path, output: Path) -> list[str]:
    """Convert a copy; a line for each folder that was made. Nothing is written where something is missing or in the way."""
    form, lacking = form_of(published, folder)
    if lacking:
        raise DataError(
            f"{folder} is no whole copy of {published.name} ({form.about}): {lacking[0]}; complete it, see omnilab dataset"
            f" check {published.name} {folder}"
        )
    if output.exists() and any(output.iterdir()):
        raise ConfigError(f"{output} holds something already; give a new folder")
    drives = [(each, below, rows) for each in form.conversions for below, rows in _drives(each, folder).items()]
    lines = [_write(conversion, rows, output / below) for conversion, below, rows in drives]
    text = "".join(
        f"{line}\n" for line in [f"{published.title}, {published.where}", f"licence: {published.licence}", *lines]
    )
    write_whole(output / DONE, lambda file: file.write(text.encode()))
    return lines


def _drives(conversion: Conversion, folder: Path) -> dict[str, list[Row]]:
    """Images and their poses, in order, for each folder below the output; positions may be NaN where only some are known."""
    if conversion.tour is not None:
        return {f"{conversion.folder}/{floor}": rows for floor, rows in _by_tour(conversion.tour, folder).items()}
    rows = _by_names(conversion, folder) if conversion.names is not None else _by_table(conversion, folder)
    if not rows:
        raise DataError(f"{folder} has no image {conversion.images} with a pose; see omnilab dataset check")
    return {conversion.folder: rows}


def _by_tour(tour: str, folder: Path) -> dict[str, list[Row]]:
    """The panoramas of each floor, in the order of their rooms, none of a floor without a scale; DataError if no floor has
    one, or a picture is missing."""
    floors = {}
    for floor, panoramas in tour_of(folder / tour).items():
        rows = {
            f"{each.room}/{Path(each.file).name}": Row(
                folder / each.file, each.x_m, each.y_m, heading=("yaw_deg", repr(each.yaw_deg)), z_m=each.z_m
            )
            for each in panoramas
        }
        if missing := [row.source for row in rows.values() if not row.source.is_file()]:
            raise DataError(f"{folder / tour} names {missing[0]}, which is not there; complete the copy")
        floors[floor] = [replace(rows[name], name=name) for name in in_order(rows)]
    if not any(floors.values()):
        raise DataError(f"{folder / tour} says of no floor how many metres its plan has ({SCALE}); take another tour")
    return floors


def _by_names(conversion: Conversion, folder: Path) -> list[Row]:
    from omnilab_recordings.folder import Folder

    assert conversion.names is not None
    sensor = Folder(str(folder), positions=None, pattern=conversion.images, **conversion.names)
    positions = sensor.recording.positions
    assert positions is not None
    return [
        Row(
            source=folder / positions.images[i],
            x_m=float(positions.position_m[i, 0]),
            y_m=float(positions.position_m[i, 1]),
            stamp_s=None if positions.stamps_ns is None else int(positions.stamps_ns[i]) / 1e9,
            heading=None if positions.numbers is None else (positions.turn[0], repr(float(positions.numbers[i]))),
        )
        for i in range(len(positions.images))
    ]


def _by_table(conversion: Conversion, folder: Path) -> list[Row]:
    table = conversion.table or {}
    known = {path.name: path for path in folder.glob(conversion.images)}
    file = folder / str(table["file"])
    entries = csv.DictReader(
        io.StringIO(content_of(file, LARGEST_TABLE).decode(errors="replace")), skipinitialspace=True
    )
    lines = [
        line
        for line in entries
        if all(line.get(key) == str(value) for key, value in (table.get("where") or {}).items())
    ]
    for column in (table[key] for key in ("image", "x", "y", "stamp_s") if key in table):
        if lines and column not in lines[0]:
            raise DataError(
                f"{file} has no column {column}, only {', '.join(map(str, lines[0]))}; is it another version of the set?"
            )
    track = None if conversion.track is None else TrackedPositions.read(conversion.track, folder)
    rows = []
    for line in lines:
        name = Path(line[table["image"]]).name
        if name not in known:
            raise DataError(f"{file} names {name}, and {folder} has no such {conversion.images}; complete the copy")
        stamp_s = _number(file, line[table["stamp_s"]]) if "stamp_s" in table else None
        if track is not None:
            x_m, y_m = track.at(float(stamp_s or 0.0))
        else:
            x_m, y_m = (_number(file, line[table[axis]]) for axis in "xy")
        rows.append(Row(known[name], x_m, y_m, stamp_s))
    return rows


@dataclass(frozen=True)
class TrackedPositions:
    """Positions at times of their own."""

    stamp_s: Floats  # (N,) ascending
    x_m: Floats
    y_m: Floats
    average_s: float
    gap_s: float

    @classmethod
    def read(cls, known: Any, folder: Path) -> TrackedPositions:
        """A headless CSV; DataError if it is none."""
        file = folder / str(known["file"])
        text = content_of(file, LARGEST_TABLE).decode(errors="replace")
        try:
            values = np.loadtxt(io.StringIO(text), delimiter=",", ndmin=2)
        except ValueError as error:
            raise DataError(f"{file} is no table of numbers ({error}); is it another version of the set?") from error
        columns = {}
        for name, column in zip(known["columns"], values.T, strict=True):
            quantity, unit = name.rsplit("_", 1)
            columns[quantity] = column * UNITS[unit]
        order = np.argsort(columns["stamp"], kind="stable")
        stamp_s, x_m, y_m = (columns[name][order] for name in ("stamp", "x", "y"))
        return cls(stamp_s, x_m, y_m, float(known["average_s"]), float(known["gap_s"]))

    def at(self, stamp_s: float) -> tuple[float, float]:
        """The position by a line fitted to `average_s` around a time, else between two at most `gap_s` apart; else NaN."""
        near = np.flatnonzero(np.abs(self.stamp_s - stamp_s) <= self.average_s / 2)
        if len(near) < 2:
            after = int(np.searchsorted(self.stamp_s, stamp_s))
            near = np.array([after - 1, after])
            if not 0 < after < len(self.stamp_s) or np.diff(self.stamp_s[near])[0] > self.gap_s:
                return float("nan"), float("nan")
        x_m, y_m = (
            np.polynomial.Polynomial.fit(self.stamp_s[near], axis[near], 1)(stamp_s) for axis in (self.x_m, self.y_m)
        )
        return float(x_m), float(y_m)


def _number(file: Path, text: str | None) -> float:
    if not (text or "").strip():
        return float("nan")
    try:
        return float(str(text).strip())
    except ValueError:
        raise DataError(f"{file} has {text!r} where a number is due; is it another version of the set?") from None


def _write(conversion: Conversion, rows: Sequence[Row], folder: Path) -> str:
    """Images copied, and their table written last; nothing of a floor without a scale."""
    if not rows:
        return f"{folder}: left out, as its plan has no scale in metres"
    (folder / "images").mkdir(parents=True)
    known = [row for row in rows if np.isfinite([row.x_m, row.y_m]).all()]
    if not conversion.truth and len(known) < len(rows):
        rows = known  # a folder's positions.csv names all its images
    taken = _names(rows)
    for row, name in zip(rows, taken, strict=True):
        (folder / "images" / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(row.source, folder / "images" / name)
    raised, stamped, turned = rows[0].z_m is not None, rows[0].stamp_s is not None, rows[0].heading
    head = [
        "image",
        "x_m",
        "y_m",
        *(["z_m"] if raised else []),
        *(["stamp_s"] if stamped else []),
        *([turned[0]] if turned else []),
    ]
    lines = [head] + [
        [f"images/{name}", f"{row.x_m:.6g}", f"{row.y_m:.6g}", *([f"{row.z_m:.6g}"] if raised else []), *([f"{row.stamp_s:.9g}"] if stamped else []),
         *([row.heading[1]] if row.heading else [])]
        for row, name in zip(rows, taken, strict=True) if np.isfinite([row.x_m, row.y_m]).all()
    ]  # fmt: skip
    file = "truth.csv" if conversion.truth else "positions.csv"
    text = "".join(f"{','.join(line)}\n" for line in lines)
    write_whole(folder / file, lambda out: out.write(text.encode()))
    return f"{folder}: {len(rows)} images, {len(known)} of them with positions ({file})"


def _names(rows: Sequence[Row]) -> list[str]:
    """A name for each image: its own where these are in order and all different, else numbered; or what the row says."""
    if all(row.name is not None for row in rows):
        return [str(row.name) for row in rows]
    names = [row.source.name for row in rows]
    if (
        len(set(names)) == len(names)
        and in_order(names) == names
        and not any(re.search(r"[,\"\s]", name) for name in names)
    ):
        return names
    return [f"{i:06d}{row.source.suffix.lower()}" for i, row in enumerate(rows)]
