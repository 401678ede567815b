"""Measurements that outlive their run folders: a JSON file, which may be a stranger's."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from omnilab.atomic_files import write_whole
from omnilab.errors import DataError
from omnilab.file_kinds import content_of
from omnilab.runner.fidelity.measured import NEVER, MeasuredRun, MeasuredValue, RunSettings, ended_at

LARGEST = 8 * 2**20  # bytes
LONGEST = 300  # characters of a text
FORMAT = "kept measurements of omnilab, 1"
TEXT = re.compile(r"[^\x00-\x1f\x7f`|<>]*")  # goes into a document
RUN_KEYS = {"seed", "configuration", "folder", "omnilab", "commit", "ended", "run_s", "values"}


def read_kept(file: Path) -> dict[str, list[MeasuredRun]]:
    """The runs of a file, by the name of their `ClaimRun`; none if there is no such file. DataError for any other file."""
    try:
        content = content_of(file, LARGEST).decode()
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as error:
        raise _no_kept(file, getattr(error, "strerror", None) or "it is no text in UTF-8") from error
    try:
        whole = _mapping(json.loads(content, parse_constant=_no_number, object_pairs_hook=_each_once), "the file")
        _keys(whole, {"format", "configurations", "runs"}, "the file")
        if whole["format"] != FORMAT:
            raise ValueError(f"its format should be '{FORMAT}'")
        configurations = {key: _settings(key, each) for key, each in _mapping(whole["configurations"], "it").items()}
        runs = _mapping(whole["runs"], "runs").items()
        return {_text(name): [_run(each, configurations) for each in _list(found)] for name, found in runs}
    except RecursionError as error:
        raise _no_kept(file, "it is nested too deeply") from error
    except (ValueError, TypeError) as error:
        line = f"line {error.lineno} is no JSON" if isinstance(error, json.JSONDecodeError) else str(error)
        raise _no_kept(file, line) from error


def write_kept(file: Path, kept: Mapping[str, Sequence[MeasuredRun]]) -> None:
    """Write the file whole, or not at all; DataError if it cannot be, or would be too large to be read again."""
    configurations = {digest(run.configuration): run.configuration for runs in kept.values() for run in runs}
    content = {
        "format": FORMAT,
        "configurations": {key: _of_settings(configurations[key]) for key in sorted(configurations)},
        "runs": {name: [_of_run(run) for run in kept[name]] for name in sorted(kept)},
    }
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    if len(data := text.encode()) > LARGEST:
        raise DataError(
            f"{file} would have {len(data)} bytes, more than {LARGEST}; keep fewer seeds, or claims apart by --claims"
        )
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, lambda out: out.write(data))
    except OSError as error:
        raise DataError(f"{file} cannot be written ({error.strerror}); give another place") from error


def merged(
    kept: Mapping[str, Sequence[MeasuredRun]], found: Mapping[str, Sequence[MeasuredRun]]
) -> dict[str, list[MeasuredRun]]:
    """What is kept, with what was found in place of the same seeds."""
    whole = {name: {run.seed: run for run in runs} for name, runs in kept.items()}
    for name, runs in found.items():
        whole.setdefault(name, {}).update({run.seed: run for run in runs if run.values})
    return {
        name: [runs[seed] for seed in sorted(runs, key=lambda s: (len(s), s))] for name, runs in whole.items() if runs
    }


def digest(configuration: RunSettings) -> str:
    """Names a configuration in the file."""
    text = json.dumps(_of_settings(configuration), sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]


def _of_settings(configuration: RunSettings) -> dict[str, Any]:
    return {"components": dict(configuration.components), "settings": dict(configuration.settings)}


def _of_run(run: MeasuredRun) -> dict[str, Any]:
    values = {text: [_or_none(each.value), each.low, each.high, _plain(each.unit)] for text, each in run.values.items()}
    known = {"omnilab": _plain(run.version), "commit": _plain(run.commit), "ended": _time(run.ended)}
    took = run.run_s if run.run_s is None else round(run.run_s, 1)
    where = {"seed": _plain(run.seed), "configuration": digest(run.configuration), "folder": _plain(run.folder)}
    return {**where, **known, "run_s": took, "values": values}


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value


def _plain(text: str) -> str:
    """What of a text of a run folder, which may be a stranger's, can stand in the file."""
    return "".join(filter(TEXT.fullmatch, text.encode("utf-8", "replace").decode()))[:LONGEST]


def _time(text: str) -> str:
    return text if ended_at(text) != NEVER else ""


def _run(content: Any, configurations: Mapping[str, RunSettings]) -> MeasuredRun:
    given = _keys(_mapping(content, "a run"), RUN_KEYS, "a run")
    if not isinstance(key := given["configuration"], str) or key not in configurations:
        raise ValueError(f"there is no configuration {key!s:.40}")
    run_s = None if given["run_s"] is None else _number(given["run_s"])
    seed, folder, version, commit, ended = (_text(given[n]) for n in ("seed", "folder", "omnilab", "commit", "ended"))
    values = {term: _value(each) for term, each in _mapping(given["values"], "values").items()}
    return MeasuredRun(seed, configurations[key], folder, version, commit, ended, run_s, values, kept=True)


def _value(content: Any) -> MeasuredValue:
    number, low, high, unit = _list(content, 4)
    return MeasuredValue(math.nan if number is None else _number(number), _bound(low), _bound(high), _text(unit))


def _bound(content: Any) -> float | None:
    return None if content is None else _number(content)


def _settings(key: str, content: Any) -> RunSettings:
    given = _keys(_mapping(content, "a configuration"), {"components", "settings"}, "a configuration")
    for part in given.values():
        if not all(isinstance(value, str) for value in _mapping(part, "a part of it").values()):
            raise TypeError("a configuration should have texts alone")
    found = RunSettings(given["components"], given["settings"])
    if digest(found) != key:
        raise ValueError(f"the configuration {key:.40} was changed by hand")
    return found


def _mapping(content: Any, what: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise TypeError(f"{what} should be a mapping")
    return content


def _keys(content: dict[str, Any], known: set[str], what: str) -> dict[str, Any]:
    if content.keys() != known:
        raise ValueError(f"{what} should have {', '.join(sorted(known))}")
    return content


def _list(content: Any, length: int | None = None) -> list[Any]:
    if not isinstance(content, list) or (length is not None and len(content) != length):
        raise TypeError(f"{content!r:.40} should be a list{f' of {length}' if length else ''}")
    return content


def _text(content: Any) -> str:
    if not isinstance(content, str) or len(content) > LONGEST or not TEXT.fullmatch(content):
        raise TypeError(f"{content!r:.40} should be a short text")
    return content


def _number(content: Any) -> float:
    if isinstance(content, bool) or not isinstance(content, int | float) or not math.isfinite(content):
        raise TypeError(f"{content!r:.40} should be a number")
    return float(content)


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a name is there twice")
    return found


def _no_kept(file: Path, why: str) -> DataError:
    return DataError(f"{file} holds no kept measurements ({' '.join(why.split())}); give another file for --keep")
