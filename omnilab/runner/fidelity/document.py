"""The table of claims as Markdown: every number of it is of a run folder, or of a file of claims."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from omnilab.errors import DataError
from omnilab.runner.compare.gathering import ComparedRun, LeftOut
from omnilab.runner.fidelity.claims import Claim, ClaimChapter, ClaimSet, Measurement
from omnilab.runner.fidelity.quantities import Quantity
from omnilab.runner.fidelity.verdicts import NOT_MEASURED, VERDICTS, SeedEstimate, SeedEstimates, estimate, verdict
from omnilab.runner.run_folder import load_run

Found = Mapping[str, Sequence[ComparedRun]]  # by the name of the `ClaimRun`, one a seed
NOTHING = "–"
TITLE = "# What the publications claim, and what is measured"
INTRODUCTION = """\
Made by `omnilab fidelity report` from run folders; nothing in it is typed by hand. The claims, with the recipes and
metrics that test them, are in [conf/claims](../conf/claims). *Its protocol* is as the publication measured, *variant* a better
method or a harder protocol, by the same expectation. An interval is of 95 %: Student's over seeds; with one run the study's
own over its queries, where it has one. The verdict is about the values, not their intervals. Times are those of the
machine that made a run, whatever else it did."""


@dataclass(frozen=True)
class ClaimResult:
    """What the runs say of a claim."""

    claim: Claim
    protocol: SeedEstimates
    variant: SeedEstimates
    verdict: str
    problems: tuple[str, ...] = ()


def results(claims: ClaimSet, found: Found) -> dict[str, list[ClaimResult]]:
    """The result of each claim, by chapter."""
    return {chapter.name: [_result(claim, found) for claim in chapter.claims] for chapter in claims.chapters}


def _result(claim: Claim, found: Found) -> ClaimResult:
    (protocol, why), (variant, more) = (_estimates(each, found) for each in (claim.protocol, claim.variant))
    return ClaimResult(claim, protocol, variant, verdict(claim.expect, protocol, variant), (*why, *more))


def _estimates(measurement: Measurement | None, found: Found) -> tuple[SeedEstimates, list[str]]:
    """Of each quantity; None if one of them was not measured. And what is wrong with runs that should have it."""
    estimates: dict[str, SeedEstimate] = {}
    for name, quantity in measurement.quantities.items() if measurement else ():
        runs = found.get(quantity.term.run, ())
        if not runs:
            return None, []
        try:
            estimates[name] = _estimate(quantity, runs)
        except (DataError, ValueError) as error:
            return None, [str(error)]
    return estimates or None, []


def _estimate(quantity: Quantity, runs: Sequence[ComparedRun]) -> SeedEstimate:
    own = quantity.interval(runs[0]) if len(runs) == 1 else None
    return estimate(quantity.values(runs), own, quantity.unit(runs[0]))


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
    notes = [f"- `{r.claim.id}`: {note}" for r in results for note in _notes(r)]
    return [f"## {chapter.title}", "", chapter.source, "", *_table(header, rows), *([""] if notes else []), *notes]


def _row(result: ClaimResult) -> list[str]:
    claim = result.claim
    return [
        f"`{claim.id}` ({claim.place}): {claim.says}",
        claim.reported,
        claim.expect.words if claim.expect else NOTHING,
        _cell(result.protocol, claim.protocol),
        _cell(result.variant, claim.variant),
        f"**{result.verdict}**",
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
    """Which run folders the numbers are of, and what is missing."""
    rows = []
    for needed in claims.needed():
        runs = found.get(needed.name, ())
        command = shlex.join(["omnilab", *needed.words])
        folders = ", ".join(f"`{run.folder.parent.name}/{run.folder.name}`" for run in runs)
        seeds = ", ".join(run.seed for run in runs)
        versions = ", ".join(dict.fromkeys(_version(run.folder) for run in runs))
        rows.append([needed.name, f"`{command}`", *(text or NOTHING for text in (seeds, folders, versions))])
    lines = ["## Runs", "", *_table(["run", "command", "seeds", "folders", "omnilab"], rows)]
    lines += ["", *(f"- {note}" for note in notes)] if notes else []
    unread = [f"- not used: {run.name} ({' '.join(filter(None, [run.state, run.why]))})" for run in left_out]
    return [*lines, *([""] if unread else []), *unread]


def _version(folder: Path) -> str:
    """Version and commit of the omnilab that made a run."""
    manifest = load_run(folder).manifest
    components = manifest.get("components", {})
    version = components.get("study", {}).get("version", "")
    commit = str(manifest.get("commit") or "")
    changed = "+changes" if commit.endswith("+changes") else ""
    return " ".join(filter(None, [str(version), f"`{commit[:7]}{changed}`" if commit else ""]))


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = [header, ["---"] * len(header), *rows]
    return ["| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in line) + " |" for line in lines]
