"""Command `omnilab convert SOURCE DIR`: a recording of any kind as the folder of docs/datasets.md, and as MCAP."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from omnilab.errors import ConfigError, DataError
from omnilab.file_kinds import kind_of_file
from omnilab_recordings.bags.log_index import READERS
from omnilab_recordings.conversion.mcap_writer import check_new, write_mcap
from omnilab_recordings.sequences.layouts import LAYOUTS


def convert(argv: Sequence[str]) -> int:
    """Write a recording (a bag, a log, a video, a sequence, a folder) as a folder of images, poses and camera; go on with one begun."""
    options = _parser().parse_args(argv)
    if options.mcap is not None:
        check_new(options.mcap)
    sensor = options.sensor or sensor_of(Path(options.source))
    settings = [text if "." in text.partition("=")[0] else f"sensor.{text}" for text in options.settings]
    if wrong := next((text for text in settings if "=" not in text), None):
        raise ConfigError(
            f"{wrong.removeprefix('sensor.')!r} is no setting of a sensor; write NAME=VALUE, such as topic=/cam/image_raw"
        )
    code = _render([f"sensor={sensor}", f"sensor.path={options.source}", *settings, f"study.folder={options.folder}"])
    if code == 0 and options.mcap is not None:
        write_mcap(options.folder, options.mcap)
        sys.stdout.write(f"{options.mcap}: the same as MCAP, for sensor=mcap and for Foxglove\n")
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("omnilab convert", description=convert.__doc__)
    parser.add_argument("source", metavar="SOURCE", help="what is read: drive.bag, run.mcap, drive.mp4, a folder")
    parser.add_argument("folder", metavar="DIR", type=Path, help="what is written: new, or begun by the same command")
    parser.add_argument(
        "settings", metavar="NAME=VALUE", nargs="*", help="settings of the sensor: topic=/cam/image_raw color=true"
    )
    parser.add_argument("--sensor", metavar="NAME", help="which sensor reads it (by what the source is)")
    parser.add_argument("--mcap", metavar="FILE", type=Path, help="write it as an MCAP log, too: new")
    return parser


def sensor_of(source: Path) -> str:
    """The sensor that reads what a path names."""
    try:
        kind = kind_of_file(source)
    except OSError as error:
        raise DataError(f"{source} cannot be read ({error.strerror or error}); give a recording") from None
    if source.is_dir():
        if (source / "zind_data.json").is_file():
            raise DataError(
                f"{source} is a tour of ZInD, of several rooms and floors; give omnilab dataset prepare zind {source} DIR"
            )
        if any(is_one(source) for is_one, _ in LAYOUTS.values()):
            return "sequence"
        logs = any(file.suffix in {".db3", ".mcap", ".bag", ".zstd"} for file in source.iterdir())
        return "rosbag" if logs else "folder"
    return {"an MCAP log": "mcap"}.get(str(kind), "rosbag" if kind in READERS else "video")


def _render(overrides: Sequence[str]) -> int:
    """The exit code of the study that writes data sets: it goes on where it was ended, and shows how far it is."""
    command = [sys.executable, "-m", "omnilab", "experiment=render", "study.layout=recorded", *overrides]
    with subprocess.Popen(command) as study:
        while True:
            try:
                return study.wait()
            except KeyboardInterrupt:  # which the study has got, too
                continue
