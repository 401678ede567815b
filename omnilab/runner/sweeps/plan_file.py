"""`sweep.yaml`: what a sweep is to do, written before its first job."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser

from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab.runner.run_folder.reading import safe_yaml
from omnilab.runner.run_folder.tables import write_text

PLAN = "sweep.yaml"
FORMAT = 1
LARGEST = 2**22  # bytes


@dataclass(frozen=True)
class SweepPlan:
    """A sweep's command and what it comes to."""

    command: list[str]  # the words after `omnilab`
    directory: str  # where it was given
    experiment: str
    parameters: dict[
        str, list[str]
    ]  # those that are swept; their values, or the one text of a range that is search_space
    jobs: int | None  # how many are planned, as far as the sweeper says
    launcher: str
    sweeper: str
    omnilab: str  # version
    time: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    format: int = FORMAT

    def write(self, folder: Path) -> None:
        """OSError if the disk does not take it."""
        import yaml

        write_text(folder / PLAN, yaml.safe_dump(asdict(self), sort_keys=False, allow_unicode=True, width=10_000))


def read_plan(folder: Path) -> SweepPlan | None:
    """The plan of a sweep; None of one of before. DataError if it is damaged, or of a later version."""
    file = folder / PLAN
    try:
        content = safe_yaml(content_of(file, LARGEST).decode())
    except FileNotFoundError:
        return None
    except Exception as error:
        why = " ".join(str(error).split())
        raise DataError(f"{file} cannot be read ({why}); move it away to see the jobs without it") from error
    if isinstance(content, dict) and type(content.get("format")) is int and content["format"] > FORMAT:
        raise DataError(
            f"{file} is of format {content['format']}, and {FORMAT} is the latest that is read here;"
            " update to the version that wrote it"
        )
    if not isinstance(content, dict) or (wrong := _wrong(content)):
        what = f"its {wrong} is missing or wrong" if isinstance(content, dict) else "it is no mapping"
        raise DataError(f"{file} cannot be read ({what}); move it away to see the jobs without it")
    return SweepPlan(**{name: content[name] for name in SweepPlan.__dataclass_fields__})


def _wrong(content: Mapping[str, Any]) -> str | None:
    """The first field that is not as it should be."""
    texts = ("directory", "experiment", "launcher", "sweeper", "omnilab", "time")
    right = {
        "format": content.get("format") == FORMAT,
        **{name: isinstance(content.get(name), str) for name in texts},
        "command": _is_texts(content.get("command")),
        "jobs": content.get("jobs", "") is None or type(content.get("jobs")) is int,
        "parameters": isinstance(content.get("parameters"), dict)
        and all(isinstance(name, str) and _is_texts(values) for name, values in content["parameters"].items()),
    }
    return next((name for name, good in right.items() if not good), None)


def _is_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(each, str) for each in value)


def swept(overrides: Sequence[str], search_space: Mapping[str, Any]) -> dict[str, list[str]]:
    """What a sweep varies: values by parameter, of overrides and of a sweeper's own parameters (`search_space`)."""
    given = [*overrides, *(f"{name}={value}" for name, value in search_space.items())]
    found: dict[str, list[str]] = {}
    for override in OverridesParser.create(config_loader=GlobalHydra.instance().config_loader()).parse_overrides(given):
        if override.is_sweep_override():
            discrete = override.is_discrete_sweep()
            values = list(map(str, override.sweep_string_iterator())) if discrete else [_text(override.input_line)]
            found[override.get_key_element()] = values
    return found


def _text(line: str | None) -> str:
    return (line or "").partition("=")[2]


def count(parameters: Mapping[str, Sequence[str]]) -> int:
    """The number of combinations."""
    return math.prod(map(len, parameters.values()))
