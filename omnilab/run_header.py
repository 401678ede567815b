"""The header of a run in its logs: which run it is, how it stands and what came out, in Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import datetime

from omnilab.api import Metric, Progress, RunResult
from omnilab.errors import visible
from omnilab.manifest import Manifest

HEADER = "header"  # the path of its record
MAIN = 3  # metrics, as in tables of runs
OF_NO_RESULT = ("experiment", "logs", "hydra", "cache", "cache_gb", "limits")  # overrides that the header leaves out
MOST_OVERRIDES, LONGEST_OVERRIDE = 8, 60
LONGEST_ERROR, LAST_LINES = 2000, 10  # characters of an error, lines of its traceback
MARKDOWN = re.compile(r"[\\`*\[\]<&~]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])")


def run_header(manifest: Manifest, status: str, result: RunResult | None = None, stage: str = "") -> str:
    """What a viewer shows of a run above everything else.

    `status`: running, done, failed, ...; `stage`: how far it is, or came, in words. Of a `result` the main metrics, and
    what ended the run.
    """
    title = plain(manifest.experiment or manifest.name)
    parts = [f"### {title}: {plain(status)}" + (f", {plain(stage)}" if stage else "")]
    metrics = result.metrics[:MAIN] if result else ()
    lines = [map(_measured, metrics), [*_origin(manifest), *_overridden(manifest.overrides)]]
    parts.append("\\\n".join(filter(None, map(" · ".join, lines))))  # a break, not a paragraph: they stand closely
    return "\n\n".join([*parts, *(_ended_by(result) if result else ())])


def in_words(progress: Progress | None) -> str:
    """How far a stage is: "queries 86 of 200"."""
    if progress is None or not progress.stage:
        return ""
    done = f" {progress.done}" if progress.done or progress.total else ""
    return progress.stage + done + (f" of {progress.total}" if progress.total else "")


def plain(text: str) -> str:
    """A text on a line of Markdown that shows it as it is."""
    return MARKDOWN.sub(lambda found: f"\\{found[0]}", visible(" ".join(text.split())))


def _ended_by(result: RunResult) -> Iterable[str]:
    """The error, and the last lines of a bug's traceback."""
    if result.error:
        kind, colon, sentence = result.error[:LONGEST_ERROR].partition(":")
        yield f"**{plain(kind)}**{colon} {plain(sentence)}".rstrip()
    if result.traceback:
        lines = [line for line in result.traceback.splitlines() if line.strip(" ^~")][-LAST_LINES:]
        yield "\n".join(f"    {visible(line)}" for line in lines)


def _measured(metric: Metric) -> str:
    unit = "" if metric.unit == "1" else f" {metric.unit}"
    value = f"**{metric.value:.4g}{unit}**" if metric.value == metric.value else "no value"
    return f"{plain(metric.name)} {value}"


def _overridden(overrides: Iterable[str]) -> Iterable[str]:
    """Each override that bears on the results, as code: a few, and how many more."""
    shown = [one for one in overrides if re.split(r"[.=]", one.lstrip("+~"))[0] not in OF_NO_RESULT]
    if not shown:
        yield "nothing overridden"
    for override in shown[:MOST_OVERRIDES]:
        text = visible(override).replace("`", "'")
        yield f"`{text[:LONGEST_OVERRIDE]}{' ...' if len(text) > LONGEST_OVERRIDE else ''}`"
    if more := len(shown) - MOST_OVERRIDES:
        yield from [f"{more} more"] * (more > 0)


def _origin(manifest: Manifest) -> Iterable[str]:
    """Seed, time, version and commit, as far as they are known."""
    if manifest.seed is not None:
        yield f"seed {manifest.seed}"
    if manifest.began:
        yield plain(_minute(manifest.began))
    if manifest.version:
        yield f"omnilab {plain(manifest.version)}"
    if manifest.commit:
        commit, plus, changes = manifest.commit.partition("+")
        yield f"commit {plain(commit[:8] + plus + changes)}"


def _minute(time: str) -> str:
    """A time in ISO 8601 as one reads it."""
    try:
        return datetime.fromisoformat(time).strftime("%Y-%m-%d %H:%M %Z").strip()
    except ValueError:
        return time
