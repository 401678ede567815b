"""The table of claims as Markdown: every number of it is of a run folder, or of a file of claims."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from omnilab.errors import DataError
from omnilab.runner.compare.gathering import LeftOut
from omnilab.runner.fidelity.claims import Claim, ClaimChapter, ClaimSet, Measurement
from omnilab.runner.fidelity.measured import MeasuredRun
from omnilab.runner.fidelity.quantities import Quantity
from omnilab.runner.fidelity.verdicts import (
    NOT_MEASURED,
    VERDICTS,
    SeedEstimate,
    SeedEstimates,
    estimate,
    is_open,
    verdict,
)

Found = Mapping[str, Sequence[MeasuredRun]]  # by the name of the `ClaimRun`, one a seed
NOTHING = "–"
TITLE = "# What the publications claim, and what is measured"
INTRODUCTION = """\
Made by `omnilab fidelity report` from run folders, and from what was kept of those that are gone (`--keep`); nothing in it is
typed by hand. The claims, with the recipes and metrics that test them, are in [conf/claims](../conf/claims). *Its protocol* is as the publication measured, *variant* a better
method or a harder protocol, by the same expectation. An interval is of 95 %: Student's over seeds; with one run the study's
own over its queries, where it has one. The verdict is about the values; with ~ it could be another within their intervals."""
TIMES = """\
† About times, which are those of the machine that made a run, whatever else it did beside: a quotient or an order of
times that lie close together says little."""


@dataclass(frozen=True)
class ClaimResult:
    """What the runs say of a claim."""

    claim: Claim
    protocol: SeedEstimates
    variant: SeedEstimates
    verdict: str
    is_open: bool = False  # it could be another within the intervals
    problems: tuple[str, ...] = ()


def results(claims: ClaimSet, found: Found) -> dict[str, list[ClaimResult]]:
    """The result of each claim, by chapter."""
    return {chapter.name: [_result(claim, found) for claim in chapter.claims] for chapter in claims.chapters}


def _result(claim: Claim, found: Found) -> ClaimResult:
    (protocol, why), (variant, more) = (_estimates(each, found) for each in (claim.protocol, claim.variant))
    values = claim.expect, protocol, variant
    return ClaimResult(claim, protocol, variant, verdict(*values), is_open(*values), (*why, *more))


def _estimates(measurement: Measurement | None, found: Found) -> tuple[SeedEstimates, list[str]]:
    """Of each quantity; None if one of them was not measured. And what is wrong with runs that should have it."""
    estimates: dict[str, SeedEstimate] = {}
    for name, quantity in measurement.quantities.items() if measurement else ():
        runs = found.get(quantity.term.run, ())
        if not runs:
            return None, []
        try:
            estimates[name] = estimate([run.value(quantity.text) for run in runs])
        except (DataError, ValueError) as error:
            return None, [str(error)]
    return estimates or None, []


def document(claims: ClaimSet, found: Found, left_out: Sequence[LeftOut], notes: Sequence[str]) -> str:
    """The whole page."""
    by_chapter = results(claims, found)
    lines = [TITLE, "", INTRODUCTION, "", *_summary(claims, by_chapter)]
    for chapter in claims.chapters:
        lines += ["", *_chapter(chapter, by_chapter[chapter.name])]
    lines += ["", *_runs(claims, found, left_out, notes)]
    return "\n".join(lines) + "\n"


def _summary(claims: ClaimSet, by_chapter: Mapping[str, Sequence[ClaimResult]]) -> list[str]:
    """How many claims have which verdict, by chapter."""
    rows, total = [], Counter[str]()
    for chapter in claims.chapters:
        counts = Counter(result.verdict for result in by_chapter[chapter.name])
        total += counts
        rows.append([chapter.title, str(counts.total()), *(str(counts[v] or NOTHING) for v in VERDICTS)])
    rows.append(["**all**", str(total.total()), *(str(total[v] or NOTHING) for v in VERDICTS)])
    return _table(["", "claims", *VERDICTS], rows)


def _chapter(chapter: ClaimChapter, results: Sequence[ClaimResult]) -> list[str]:
    """A row a claim; below, the reasons and the notes."""
    header = ["claim", "reported", "holds if", "its protocol", "variant", "verdict", "runs"]
    rows = [_row(result) for result in results]
    times = ["", TIMES] if any(result.claim.is_time for result in results) else []
    notes = [f"- `{r.claim.id}`: {note}" for r in results for note in _notes(r)]
    lines = [f"## {chapter.title}", "", chapter.source, "", *_table(header, rows), *times]
    return [*lines, *([""] if notes else []), *notes]


def _row(result: ClaimResult) -> list[str]:
    claim = result.claim
    return [
        f"`{claim.id}` ({claim.place}): {claim.says}",
        claim.reported,
        claim.expect.words if claim.expect else NOTHING,
        _cell(result.protocol, claim.protocol),
        _cell(result.variant, claim.variant),
        f"**{result.verdict}**{' ~' if result.is_open else ''}{' †' if claim.is_time else ''}",
        ", ".join(claim.runs) or NOTHING,
    ]


def _cell(estimates: SeedEstimates, measurement: Measurement | None) -> str:
    if measurement is None:
        return NOTHING
    if estimates is None:
        return NOT_MEASURED
    parts = [_named(name, estimates[name], quantity) for name, quantity in measurement.quantities.items()]
    return "; ".join(parts)


def _named(name: str, value: SeedEstimate, quantity: Quantity) -> str:
    """As "radon: 0.97 [0.95, 0.99] m (3 seeds)"; a single quantity by its metric."""
    interval = "" if value.low is None or value.high is None else f" [{value.low:.3g}, {value.high:.3g}]"
    seeds = "one run" if value.seeds == 1 else f"{value.seeds} seeds"
    title = name or f"`{quantity.text}`"
    return f"{title} {value.value:.4g}{interval}{f' {value.unit}' if value.unit else ''} ({seeds})"


def _notes(result: ClaimResult) -> list[str]:
    claim = result.claim
    why_not = f"cannot be tested: {claim.not_reproduced}" if claim.not_reproduced else ""
    return [note for note in (why_not, claim.note, *result.problems) if note]


def _runs(claims: ClaimSet, found: Found, left_out: Sequence[LeftOut], notes: Sequence[str]) -> list[str]:
    """Which runs the numbers are of, and what is missing."""
    rows = []
    for needed in claims.needed():
        runs = found.get(needed.name, ())
        command = shlex.join(["omnilab", *needed.words])
        columns = (
            [run.seed for run in runs],
            [f"`{run.folder}`{' (kept)' if run.kept else ''}" for run in runs],
            dict.fromkeys(run.made_by for run in runs),
            dict.fromkeys(run.ended[: len("2000-01-01")] for run in runs),
            [f"{run.run_s / 60:.1f}" for run in runs if run.run_s is not None],
        )
        rows.append([needed.name, f"`{command}`", *(", ".join(column) or NOTHING for column in columns)])
    lines = ["## Runs", "", *_table(["run", "command", "seeds", "folders", "omnilab", "ended", "minutes"], rows)]
    lines += ["", *(f"- {note}" for note in notes)] if notes else []
    unread = [f"- not used: {run.name} ({' '.join(filter(None, [run.state, run.why]))})" for run in left_out]
    return [*lines, *([""] if unread else []), *unread]


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = [header, ["---"] * len(header), *rows]
    return ["| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in line) + " |" for line in lines]
