"""Several runs in one viewer: which of them can be shown, and what cannot."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from omnilab.atomic_files import write_whole
from omnilab.errors import ConfigError, DataError
from omnilab.hooks import Runs, RunSummary
from omnilab_rerun.binary import join
from omnilab_rerun.colors import RUNS
from omnilab_rerun.several.comparison import not_common, write_comparison
from omnilab_rerun.several.contents import RecordingContents, contents_of
from omnilab_rerun.several.differences import differences, short_names
from omnilab_rerun.several.merging import ShownRun, merge
from omnilab_rerun.sink import FILE
from omnilab_rerun.viewer import show, take_picture

SIZE = (1600, 900)  # of a picture, pixels


def view_several(runs: Runs, folders: Sequence[Path], screenshot: Path | None, step: int | None) -> None:
    """Show runs side by side, or take their picture. What is not shown is said.

    ConfigError for one that is given twice, and for more than can be told apart; DataError if none has a recording.
    """
    with _merged(runs, folders) as (merged, layout):
        if screenshot is None:
            show(merged, layout)
        else:
            take_picture(merged, screenshot, step, SIZE, layout, title="the merged recording")


def save_several(runs: Runs, folders: Sequence[Path], target: Path) -> None:
    """Write runs side by side, with their layout, as one recording; errors as of `view_several`, and of the disk.

    The file is written whole or not at all.
    """
    if target.suffix != ".rrd":
        raise ConfigError(f"{target} would be a recording by another name; give {target.with_suffix('.rrd')}")
    with _merged(runs, folders) as parts:
        try:
            write_whole(target, lambda out: join(reversed(parts), out))  # the layout first: a page shows what has come
        except OSError as error:
            raise DataError(f"{target} cannot be written ({error.strerror}); give another path") from error


@contextmanager
def _merged(runs: Runs, folders: Sequence[Path]) -> Iterator[tuple[Path, Path]]:
    """The recordings as one, and its layout: two files that go afterwards."""
    _check(folders)
    recorded = []
    for summary in map(runs.summary, folders):
        if (ready := runs.ready(summary.folder) / FILE).is_file():
            recorded.append((summary, ready))
        else:
            _say(f"{summary.folder} has no {FILE} and is left out; run it with the sink rerun")
    if not recorded:
        raise DataError(f"none of the {len(folders)} runs has a recording; run the experiments with the sink rerun")
    summaries = [summary for summary, _ in recorded]
    different = differences(summaries)
    contents = _with_layouts([contents_of(recording) for _, recording in recorded], summaries)
    looks = zip(short_names(summaries, different), RUNS.values(), recorded, contents, strict=False)
    shown = [ShownRun(name, color, recording, inside) for name, color, (_, recording), inside in looks]
    for sentence in not_common(shown, summaries):
        _say(sentence)
    with tempfile.TemporaryDirectory(prefix="omnilab-") as place:
        merged, layout = Path(place) / "runs.rrd", Path(place) / "layout.rrd"
        merge(shown, merged)
        write_comparison(shown, summaries, different, layout)
        yield merged, layout


def _with_layouts(found: Sequence[RecordingContents], summaries: Sequence[RunSummary]) -> list[RecordingContents]:
    """A recording that has no layout gets that of another run of its study."""
    studies = [summary.components.get("study") for summary in summaries]
    layouts = {study: inside.panels for study, inside in zip(studies, found, strict=True) if inside.panels}
    return [
        replace(inside, panels=inside.panels or layouts.get(study) or inside.simple_panels())
        for study, inside in zip(studies, found, strict=True)
    ]


def _check(folders: Sequence[Path]) -> None:
    if len(folders) > len(RUNS):
        raise ConfigError(
            f"{len(folders)} runs are more than can be told apart; give up to {len(RUNS)}, such as"
            f" {' '.join(map(str, folders[:2]))}"
        )
    places = [folder.resolve() for folder in folders]
    for i, place in enumerate(places):
        if place in places[:i]:
            raise ConfigError(f"{folders[i]} is given twice; give each run once")


def _say(sentence: str) -> None:
    sys.stderr.write(f"omnilab: {sentence}\n")
