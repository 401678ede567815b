"""What is promised of the files that a command leaves, however it ended. Each check gives sentences about what is broken."""

from __future__ import annotations

import csv
import hashlib
import json
import re
import struct
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np
import torture_witness
import yaml
from torture_commands import Ended, forked, run

from omnilab.atomic_files import PART
from omnilab.runner.run_folder import LoadedRun, find_runs

PLANTED = "a user's own file\n"
HEAD = struct.Struct("<QQ")  # kind and length of each message of a recording
LOST_NS = 1_000_000_000  # what was logged up to so long before a kill is in both logs
TABLES = (
    "cost.csv",
    "times.csv",
    "robustness.csv",
    "summary.csv",
)  # which say how long it took, or what became of all jobs


# ------------------------------------------------------------------------------------------------- files of a user
def plant(folder: Path) -> None:
    """Files of a user, in all places where they could be taken for ours."""
    for name in ("logs/notes.txt", "logs/cache/own.npz", "logs/cache/0123456789abcdef0123456789abcdef/x.npz", "a.part"):
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(PLANTED)


def plant_in_dataset(folder: Path) -> None:
    """The same in a data set that was begun."""
    for name in ("notes.txt", "images/000001.png.part", "images/own.txt"):
        if (folder / "set/images").is_dir() and (folder / "set/dataset.json").exists():
            (folder / "set" / name).write_text(PLANTED)


def planted(folder: Path) -> set[Path]:
    """All files of a user that are still as they were."""
    names = [path for path in folder.rglob("*") if path.is_file() and not path.is_symlink()]
    return {path for path in names if path.stat().st_size == len(PLANTED) and path.read_text() == PLANTED}


# ------------------------------------------------------------------------------------------------------ whole files
def torn_files(folder: Path) -> Iterator[str]:
    """Each file is whole or has a name that nobody reads; the logs of a run that did not end may be torn."""
    mine = planted(folder)
    for path in sorted(folder.rglob("*")):
        if (
            path.is_symlink()
            or not path.is_file()
            or path in mine
            or re.fullmatch(r".*(\.part|" + PART + ")", path.name)
        ):
            continue
        try:
            _check_whole(path)
        except Exception as error:  # noqa: BLE001  of whatever reader
            yield f"{path.relative_to(folder)} is not whole: {type(error).__name__}: {error}"


def _check_whole(path: Path) -> None:
    """An exception if it is torn."""
    match path.suffix:
        case ".json":
            json.loads(path.read_text())
        case ".yaml":
            assert isinstance(yaml.safe_load(path.read_text()), dict) or path.read_text() == ""
        case ".csv":
            text = path.read_text()
            rows = list(csv.reader(text.splitlines(), strict=True))
            assert text.endswith("\n")
            assert len({len(row) for row in rows}) == 1
        case ".png":
            data = path.read_bytes()
            assert data.endswith(b"IEND\xaeB`\x82"), "no end"
            assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) is not None
        case ".npz":
            with zipfile.ZipFile(path) as archive:
                assert archive.testzip() is None
        case ".npy":
            np.load(path)
        case ".rrd" | ".mcap" | ".damaged" | ".lock":  # logs are mended; a lock is held or not, whatever it says
            return
        case _:
            path.read_text()


# ------------------------------------------------------------------------------------------------------------- runs
def runs_of(folder: Path) -> list[LoadedRun]:
    """All runs that there are."""
    return find_runs(folder / "logs") if (folder / "logs").is_dir() else []


def listing(folder: Path, *states: str) -> Iterator[str]:
    """`omnilab runs` shows every run, in one of these states."""
    if not (folder / "logs").is_dir():
        return
    shown = run(folder, "runs")
    if shown.code != 0 or "Traceback" in shown.stderr:
        yield f"omnilab runs: {shown.said}"
    for found in runs_of(folder):
        name = found.folder.relative_to(folder / "logs").as_posix()
        if name not in shown.stdout:
            yield f"omnilab runs does not show {name}: {shown.said}"
        if found.state not in states:
            yield f"{name} is {found.state}, not {' or '.join(states)}"


def latest(folder: Path) -> Iterator[str]:
    """`logs/latest` is a link to the run that ended last."""
    newest = max(runs_of(folder), key=lambda found: (found.folder / "status.json").stat().st_mtime_ns).folder
    link = folder / "logs/latest"
    if not link.is_symlink() or link.resolve() != newest.resolve():
        yield f"{link} is {link.resolve()}, not {newest}"


def mended_logs(folder: Path, killed_ns: int = 0) -> Iterator[str]:
    """`omnilab repair` mends the logs of each run that did not end; other readers read them, and little is lost."""
    for found in runs_of(folder):
        if found.state == "done":
            yield from unreadable_logs(found.folder)
            continue
        place, recording = str(found.folder), found.folder / "run.rrd"
        is_empty = holds_nothing(recording)
        mended = run(folder, "repair", place)
        if is_empty and mended.code == 2 and f"{recording} cannot be read back" in mended.stderr:
            continue  # there is nothing to keep, which a sentence says
        if mended.code != 0 or "Traceback" in mended.stderr:
            yield f"repair: {mended.said}"
            continue
        again = run(folder, "repair", place)
        if again.code != 0 or "nothing to repair" not in again.stderr:
            yield f"repair, again: {again.said}"
        yield from unreadable_logs(found.folder)
    if killed_ns:
        yield from lost_records(folder, killed_ns)


def holds_nothing(recording: Path) -> bool:
    """Whether a recording is there, and was torn before its first rows were whole."""
    data = recording.read_bytes() if recording.exists() else b""
    at, kind = 12, 1  # behind the header; a message about the recording itself
    while at + HEAD.size <= len(data) and kind == 1:
        kind, length = HEAD.unpack_from(data, at)
        at += HEAD.size + length
    return recording.exists() and (at > len(data) or kind == 1)


def unreadable_logs(folder: Path) -> Iterator[str]:
    """What others' readers say of a run's logs."""
    for name, read in (("run.mcap", _mcap), ("run.rrd", _rrd)):
        if (folder / name).exists() and (folder / name).stat().st_size:
            try:
                forked(read, folder / name)
            except Exception as error:  # noqa: BLE001  of whatever reader
                yield f"{folder.name}/{name} cannot be read: {type(error).__name__}: {error}"


def lost_records(folder: Path, killed_ns: int) -> Iterator[str]:
    """What the witness saw more than a second before the kill is in both logs of its run."""
    for found in runs_of(folder):
        noted = torture_witness.noted(folder.parent / "witness", found.folder)
        for name, read in (("run.mcap", _mcap), ("run.rrd", _rrd)) if noted else ():
            log = found.folder / name
            there = set() if name == "run.rrd" and holds_nothing(log) else forked(read, log)
            lost = [killed_ns - at for at, path, step in noted if (path, step) not in there]
            if lost and max(lost) > LOST_NS:
                yield (
                    f"{found.folder.name}/{name} has lost {len(lost)} of {len(noted)} records, the oldest"
                    f" {max(lost) / 1e9:.2f} s before the kill"
                )


def _mcap(path: Path) -> set[tuple[str, int]]:
    """Topics and steps."""
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_summary() is not None
        return {(channel.topic, message.sequence) for _, channel, message in reader.iter_messages()}


def _rrd(path: Path) -> set[tuple[str, int]]:
    """Entities and steps."""
    from rerun.chunk import RrdReader

    found = set()
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        if "step" in chunk.timeline_names:  # a study may have a metric of this name, which the run's properties show
            found |= {(chunk.entity_path, step) for step in batch.column("step").cast("int64").to_pylist()}
    return found


# ---------------------------------------------------------------------------------------------------------- results
def results(folder: Path) -> dict[str, bytes]:
    """What the newest run, or all jobs of the newest sweep, computed; and the data set."""
    latest = (folder / "logs/latest").resolve()
    found = results_of(latest.parent if (latest.parent / "summary.csv").exists() else latest)
    mine = planted(folder)
    for path in sorted((folder / "set").rglob("*")):
        if path.is_file() and path not in mine and path.suffix != ".part":
            found[f"set/{path.relative_to(folder / 'set')}"] = hashlib.sha256(path.read_bytes()).digest()
    return found


def results_of(run_folder: Path) -> dict[str, bytes]:
    """What a run computed, without what depends on time."""
    found: dict[str, bytes] = {}
    for path in sorted(run_folder.rglob("*")):
        name = path.relative_to(run_folder).as_posix()
        if path.suffix == ".csv" and path.name not in TABLES:
            found[name] = path.read_bytes()
        if path.name == "map.npz":
            with np.load(path) as arrays:
                found |= {f"{name}:{key}": arrays[key].tobytes() for key in arrays if arrays[key].dtype != object}
    return found


def differences(found: Mapping[str, bytes], expected: Mapping[str, bytes]) -> Iterator[str]:
    """Where results are not, byte for byte, those of a command that nothing disturbed."""
    for name in sorted(found.keys() | expected.keys()):
        if found.get(name) != expected.get(name):
            there, wanted = ("not there" if each is None else "there" for each in (found.get(name), expected.get(name)))
            yield f"{name} differs from that of a command that was not disturbed ({there}, and should be {wanted})"


def all_metrics(folder: Path) -> set[bytes]:
    """The contents of all `metrics.csv` there."""
    return {path.read_bytes() for path in folder.rglob("metrics.csv")}


def wrong_metrics(folder: Path, complete: set[bytes]) -> Iterator[str]:
    """`metrics.csv` is absent or one of these, in every run; and there once a run is done."""
    for found in runs_of(folder):
        file = found.folder / "metrics.csv"
        if file.exists() and file.read_bytes() not in complete:
            yield f"{file} is neither absent nor complete: {file.read_text()[:300]}"
        if found.state == "done" and not file.exists():
            yield f"{found.folder.name} is done and has no metrics.csv"


# ----------------------------------------------------------------------------------------------------------- output
def sentences(ended: Ended, most: int = 30) -> Iterator[str]:
    """What a user is told: no traceback, not page after page."""
    told = [line for line in ended.stderr.splitlines() if line.startswith("omnilab: ")]
    if "Traceback" in ended.stderr or "Exception ignored" in ended.stderr or "panicked" in ended.stderr:
        yield f"a traceback: {ended.said}"
    elif len(told) > most:
        yield f"{len(told)} lines: {ended.said}"
    elif ended.code == 2 and not told:
        yield f"ended with 2 and without a sentence: {ended.said}"
