"""The command `omnilab report`."""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

from omnilab.atomic_files import write_whole
from omnilab.errors import DataError
from omnilab_serve.run_details.files import RECORDING, open_file


def report(argv: list[str]) -> int:
    """Write a report of a run, a sweep, or several compared: one HTML file that needs nothing else, and prints well."""
    options = _parser().parse_args(argv)
    folders = list(dict.fromkeys(folder.resolve() for folder in options.folders))
    target = options.output or Path(f"{folders[0].name}-report.html")
    if target.exists() and not target.is_file():
        raise DataError(f"{target} is no file that could be replaced; give another with --output FILE.html")
    from omnilab_serve.reports.building import report_page

    beside = {folder: _recording_name(target, folder, folders) for folder in folders if _has_recording(folder)}
    page = report_page(folders, beside if options.recording else {})
    try:
        write_whole(target, lambda out: out.write(page.encode(errors="backslashreplace")))
        sys.stderr.write(f"omnilab: the report is {target}\n")
        for folder, name in beside.items() if options.recording else ():
            _copy(folder / RECORDING, target.with_name(name))
            sys.stderr.write(f"omnilab: a recording lies beside it: {name}\n")
    except OSError as error:
        raise DataError(f"{error.filename} cannot be written ({error.strerror}); give another place") from error
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("omnilab report", description=report.__doc__)
    add = parser.add_argument
    add("folders", nargs="+", type=Path, metavar="RUN|SWEEP", help="folders of runs and sweeps; several are compared")
    add("--output", type=Path, metavar="FILE.html", help="what is written, or replaced (default: NAME-report.html)")
    add("--recording", action="store_true", help="copy the recordings of the runs beside the report")
    return parser


def _has_recording(folder: Path) -> bool:
    return (folder / RECORDING).is_file()


def _recording_name(target: Path, folder: Path, folders: list[Path]) -> str:
    """Of its own for every run."""
    return f"{target.stem}.rrd" if len(folders) == 1 else f"{target.stem}-{folders.index(folder) + 1}.rrd"


def _copy(source: Path, target: Path) -> None:
    with open_file(source) as file:
        write_whole(target, lambda out: shutil.copyfileobj(file, out, 1 << 20))
