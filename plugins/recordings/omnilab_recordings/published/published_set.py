"""What is known of a published data set: a YAML file a set, shipped or a user's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from omnilab.errors import ConfigError, DataError, did_you_mean
from omnilab.file_kinds import content_of

LARGEST_FILE = 2**16  # bytes


@dataclass(frozen=True)
class ExpectedFiles:
    """Files that a copy of a set holds."""

    glob: str  # below the folder
    count: int | None = None  # how many; None: one or more
    sha256: str | None = None  # of a single file


@dataclass(frozen=True)
class Conversion:
    """How one drive or series of a set becomes a documented folder: by `names`, a `table` (with a `track`), or a `tour`.

    `names` are settings of sensor folder (names, spacing_m, columns). `table` is a CSV with a row per image: `image`, `x`,
    `y`, `stamp_s` name its columns, `where` the values that other columns have in its rows. `track` is `table` with the
    images' times alone, and a headless CSV of positions at times of their own (`track.file`; `track.columns`: stamp_ms,
    x_cm and the like, in order), averaged over `track.average_s` and interpolated across gaps of up to `track.gap_s`.
    `tour` is the zind_data.json of a home: each of its floors becomes a folder of its own in `folder`.
    """

    folder: str  # below the output; "." is the output itself
    images: str  # a glob of its images; in tables that name other folders, only the name of the file counts
    names: Mapping[str, Any] | None = None
    table: Mapping[str, Any] | None = None
    track: Mapping[str, Any] | None = None
    tour: str | None = None
    truth: bool = False  # positions go into truth.csv, which may leave images out (study.truth), not into positions.csv


@dataclass(frozen=True)
class Form:
    """One way in which copies of a set lie on disk."""

    about: str
    files: Sequence[ExpectedFiles]
    conversions: Sequence[Conversion]


@dataclass(frozen=True)
class PublishedSet:
    """A data set that users download themselves."""

    name: str
    title: str
    where: str  # it is had
    licence: str
    cite: str
    naming: str  # "verified: by what", or "not verified"
    forms: Sequence[Form] = ()  # none: there is no conversion, see `notes`
    sensor: Mapping[str, Any] = field(default_factory=dict)  # settings of sensor folder for what was prepared
    notes: str = ""

    @property
    def verified(self) -> bool:
        """Whether its naming was read off a copy, or off other people's code that parses one."""
        return self.naming.startswith("verified")


def shipped_names() -> list[str]:
    """Names of the sets that are shipped."""
    return sorted(
        Path(each.name).stem for each in files(__package__).joinpath("sets").iterdir() if each.name.endswith(".yaml")
    )


def published_set(name: str) -> PublishedSet:
    """A shipped set by its name, or one described in a user's own file (.yaml)."""
    if name.endswith((".yaml", ".yml")):
        return _parsed(name, content_of(name, LARGEST_FILE).decode(errors="replace"))
    if name not in shipped_names():
        raise ConfigError(
            f"no data set '{name}'{did_you_mean(name, shipped_names())}; there is {', '.join(shipped_names())}, or a .yaml"
            " of your own"
        )
    return _parsed(name, files(__package__).joinpath("sets", f"{name}.yaml").read_text("utf-8"))


def _parsed(name: str, text: str) -> PublishedSet:
    try:
        known = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise DataError(f"{name} is no YAML ({' '.join(str(error).split())}); mend it") from error
    found = _made(PublishedSet, name, {"name": Path(name).stem, **(known if isinstance(known, dict) else {})})
    forms = [_made(Form, name, each) for each in found["forms"]] if "forms" in found else []
    found["forms"] = [
        Form(
            form["about"],
            [ExpectedFiles(**_made(ExpectedFiles, name, each)) for each in form["files"]],
            [_conversion(name, each) for each in form["conversions"]],
        )
        for form in forms
    ]
    return PublishedSet(**found)


def _conversion(name: str, known: Any) -> Conversion:
    found = Conversion(**_made(Conversion, name, known))
    if found.names is not None and (found.table is not None or found.track is not None):
        raise DataError(f"{name} gives the poses of {found.folder} by names and by a table; keep one of the two")
    if found.names is None and found.table is None and found.tour is None:
        raise DataError(f"{name} does not say how poses of {found.folder} are known; give names, table or tour")
    for path in (
        found.folder,
        found.images,
        str(found.tour or ""),
        *(str(each.get("file", "")) for each in (found.table or {}, found.track or {})),
    ):
        if Path(path).is_absolute() or ".." in Path(path).parts:
            raise DataError(f"{name} names {path}, which leads out of its folder; give paths below it")
    return found


def _made(cls: type[Any], name: str, known: Any) -> dict[str, Any]:
    """The fields of a class; DataError for one that is missing or that it does not have."""
    if not isinstance(known, dict):
        raise DataError(f"{name} has {known!r} where a {cls.__name__} is due; give a mapping of its fields")
    own = {each.name: each for each in fields(cls)}
    for key in known:
        if key not in own:
            raise DataError(
                f"{name} has '{key}', which a {cls.__name__} does not{did_you_mean(str(key), list(own))}; remove it"
            )
    required = [each for each in list(own)[: _required(cls)] if each not in known]
    if required:
        raise DataError(f"{name} lacks {', '.join(required)}, which a {cls.__name__} needs; add it")
    return dict(known)


def _required(cls: type[Any]) -> int:
    """How many of a class's first fields have no default."""
    from dataclasses import MISSING

    return sum(each.default is MISSING and each.default_factory is MISSING for each in fields(cls))
