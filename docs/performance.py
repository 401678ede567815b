"""Makes docs/performance.md from the benchmarks: uv run python docs/performance.py [--long | --from JSON ...] [BENCHMARKS]

It runs the short benchmarks, with --long those marked `slow`, or the named ones of either (paths, node ids), by processor time
and in one thread; --from takes files of `pytest --benchmark-json` instead, without any the page is only written anew. What was
not measured now stays in docs/performance.json, and on the page, with the commit and the day of its run; a ratio is taken only
within a run. The page's prose is written by hand; what stands between `<!-- made: ... -->` and `<!-- end -->` never is.

A benchmark says what the page should know in its `extra_info`; all of it may be left out:

    what        its name in the table; as a rule that of its parameters, or of the test
    peer        true of what one would take instead of omnilab
    unit, count what a round works on and how many of it, "image", 64: times are those of one
    size, of    how large the problem is, 400, "views": the growth of cost is fitted over the sizes of a `what`
    memory_mb   what it needs; as a rule by how much the process grew
    no_peer     why nothing can stand beside it: of one benchmark of a group
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

HERE = Path(__file__).parent
ROOT = HERE.parent
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
UNITS = ((60.0, "min"), (1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))
PART = re.compile(r"(<!-- made: (\w+)((?: \w+)*) -->\n).*?(<!-- end -->)", re.DOTALL)


@dataclass(frozen=True)
class Row:
    """What the page knows of a benchmark: seconds are those of one unit, quartiles and all, and what all rounds took."""

    test: str
    group: str
    what: str
    peer: bool
    unit: str
    size: float | None
    of: str
    memory_mb: float | None
    no_peer: str
    quarter_s: float
    median_s: float
    three_quarters_s: float
    rounds: int
    took_s: float
    wall: bool
    run: str

    @property
    def module(self) -> str:
        """`views` of tests/benchmarks/test_bench_views.py::test_view_ekf[12]."""
        return Path(self.test.partition("::")[0]).stem.removeprefix("test_bench_")

    @property
    def function(self) -> str:
        """The test without its parameters."""
        return self.test.partition("[")[0]

    @property
    def label(self) -> str:
        """Its name, and its size where it has one."""
        return self.what if self.size is None else f"{self.what}, {self.size:,.12g} {self.of}".rstrip()


def measure(tests: Sequence[str], out: Path, root: Path = ROOT, command: Sequence[str] = (sys.executable,)) -> int:
    """Run benchmarks of a checkout by processor time, in one thread, into a JSON file; pytest's exit code."""
    words = [
        *command, "-m", "pytest", "-n", "0", "-q", "--benchmark-enable", "--benchmark-disable-gc", "--benchmark-columns=median,rounds",
        "--benchmark-timer=time.process_time", f"--benchmark-json={out}", *tests,
    ]  # fmt: skip
    environment = {name: value for name, value in os.environ.items() if name != "VIRTUAL_ENV"}
    done = subprocess.run(words, cwd=root, env=environment | ONE_THREAD, stdout=sys.stderr, check=False)
    return done.returncode


def read(text: str) -> tuple[list[Row], dict[str, str]]:
    """The rows of a file of pytest-benchmark, and what is said of its run: commit, date, processor and Python."""
    found = json.loads(text)
    commit, machine = found["commit_info"], found["machine_info"]
    cpu = machine.get("cpu", {})
    name = (
        f"{str(commit.get('id'))[:7]}{'+' if commit.get('dirty') else ''}, {found['datetime'][:16].replace('T', ' ')}"
    )
    about = {
        "run": name,
        "processor": f"{cpu.get('brand_raw', '?')}, {cpu.get('count', '?')} cores",
        "python": machine["python_version"],
    }
    return [row_of(one, name) for one in found["benchmarks"]], about


def row_of(one: dict[str, Any], run: str) -> Row:
    """One benchmark as pytest-benchmark writes it."""
    says, stats = one["extra_info"], one["stats"]
    size, count, peer = says.get("size"), says.get("count", 1), says.get("peer", False)
    test = re.sub(r"^test_(bench_)?", "", one["name"].partition("[")[0]).replace("_", " ")
    named = peer if isinstance(peer, str) else ""
    return Row(
        test=one["fullname"],
        group=one["group"] or test,
        what=says.get("what") or named or (size is None and one.get("param")) or test,
        peer=bool(peer),
        unit=says.get("unit", ""),
        size=size,
        of=says.get("of", ""),
        memory_mb=says.get("memory_mb"),
        no_peer=says.get("no_peer", ""),
        quarter_s=stats["q1"] / count,
        median_s=stats["median"] / count,
        three_quarters_s=stats["q3"] / count,
        rounds=stats["rounds"],
        took_s=stats["total"] * stats["iterations"],
        wall="process" not in one["options"]["timer"],
        run=run,
    )


# ------------------------------------------------------------------------------------------------------- what was kept
def merged(kept: Iterable[Row], new: Sequence[Row], root: Path = ROOT) -> list[Row]:
    """New rows, and those of before whose test was not measured now and still exists."""
    measured = {row.function for row in new}
    return [row for row in kept if row.function not in measured and exists(row.function, root)] + list(new)


def exists(function: str, root: Path) -> bool:
    """Whether the test is still in its file."""
    path, _, name = function.partition("::")
    file = root / path
    return file.is_file() and f"def {name.rpartition('::')[2]}(" in file.read_text(encoding="utf-8")


def load(path: Path) -> tuple[list[Row], list[dict[str, str]]]:
    """Rows and runs of docs/performance.json; none where there is no such file."""
    if not path.exists():
        return [], []
    kept = json.loads(path.read_text(encoding="utf-8"))
    return [Row(**row) for row in kept["benchmarks"]], kept["runs"]


def save(path: Path, rows: Sequence[Row], runs: Sequence[dict[str, str]]) -> None:
    """A row a line, so that a difference of two commits can be read."""
    lines = {
        "runs": [json.dumps(run, ensure_ascii=False) for run in runs],
        "benchmarks": [json.dumps(asdict(row), ensure_ascii=False) for row in sorted(rows, key=lambda row: row.test)],
    }
    parts = ['"' + name + '": [\n' + ",\n".join(found) + "\n]" for name, found in lines.items()]
    path.write_text("{" + ",\n".join(parts) + "}\n", encoding="utf-8")


# ------------------------------------------------------------------------------------------------------------- numbers
def duration(row: Row) -> str:
    """The median and the quartiles in a unit that suits, and what else is to be known of them."""
    scale, unit = next((found for found in UNITS if row.median_s >= found[0]), UNITS[-1])
    numbers = [f"{seconds / scale:.3g}" for seconds in (row.median_s, row.quarter_s, row.three_quarters_s)]
    spread = f" ({numbers[1]} to {numbers[2]})" if row.rounds > 1 else " (once)"
    return f"{numbers[0]} {unit}{spread}{' of wall time' if row.wall else ''}"


def ratio(number: float) -> str:
    """Three digits, none behind the point from 10 on."""
    return f"{number:,.0f}" if number >= 10 else f"{number:.3g}"


def beside(row: Row, group: Iterable[Row]) -> Row | None:
    """The fastest peer of its group, run, clock and size; one that has no size stands beside all."""
    peers = [
        other
        for other in group
        if other.peer and (other.run, other.wall) == (row.run, row.wall) and other.size in {row.size, None}
    ]
    return min(peers, key=lambda other: other.median_s, default=None)


def exponent(size: Sequence[float], seconds: Sequence[float]) -> tuple[float, float, float]:
    """The least-squares slope of log time over log size, and the ends of its interval of 95 % (Student's, n - 2)."""
    from scipy.stats import linregress, t

    line = linregress(np.log(size), np.log(seconds))
    half = float(t.ppf(0.975, len(size) - 2)) * line.stderr
    return float(line.slope), float(line.slope - half), float(line.slope + half)


# -------------------------------------------------------------------------------------------------------------- tables
def grouped(rows: Iterable[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Rows by group, in the order of the groups' names; sizes rise, peers come last."""
    ordered = sorted(rows, key=lambda row: (row.group, row.peer, row.what, row.size or 0))
    for group, found in groupby(ordered, key=lambda row: row.group):
        yield group, list(found)


def times(rows: Sequence[Row], most: str) -> Iterator[str]:
    """A line for each benchmark of omnilab beside its fastest peer, and one for each other peer."""
    yield from ("| | omnilab | beside it | its time | ratio | memory |", "|---|---|---|---|---|---|")
    for group, found in grouped(rows):
        units = {row.unit for row in found if row.unit}
        yield f"| **{group}**{f', {units.pop()}' if len(units) == 1 else ''} | | | | | |"
        best = {row.test: beside(row, found) for row in found if not row.peer}
        shown = {peer.test for peer in best.values() if peer}
        yield from (line(row, best.get(row.test), most) for row in found if row.test not in shown)


def line(row: Row, peer: Row | None, most: str) -> str:
    """A row of the table; what another run measured than that of most rows says which."""
    time = duration(row) + ("" if row.run == most else f" [{row.run.partition(',')[0]}]")
    cells = ["", "", row.label, time, ""] if row.peer else [row.label, time, "", "", ""]
    memory = f"{row.memory_mb:,.0f} MB" if (row.memory_mb or 0) >= 0.5 else ""
    if peer is not None:
        cells[2:] = [peer.what, duration(peer), ratio(peer.median_s / row.median_s)]
        memory += f" ({max(0.0, peer.memory_mb):,.0f})" if memory and peer.memory_mb is not None else ""
    return "| " + " | ".join([*cells, memory]) + " |"


def growth(rows: Iterable[Row]) -> Iterator[str]:
    """Exponents of what was measured at three sizes or more, all in one run."""
    yield from ("| | from | to | exponent | interval of 95 % | of the last two |", "|---|---|---|---|---|---|")
    for group, found in grouped(row for row in rows if row.size):
        for what, same in groupby(found, key=lambda row: row.what):
            series = list(same)
            size, seconds = [row.size or 0 for row in series], [row.median_s for row in series]
            if len(set(size)) < 3 or len(set(size)) < len(size) or len({(row.run, row.wall) for row in series}) > 1:
                continue
            slope, low, high = exponent(size, seconds)
            last = np.log(seconds[-1] / seconds[-2]) / np.log(size[-1] / size[-2])
            ends = " | ".join(f"{row.size:,.12g} {row.of}: {duration(row)}" for row in (series[0], series[-1]))
            yield f"| {group}: {what} | {ends} | {slope:.2f} | {low:.2f} to {high:.2f} | {last:.2f} |"


def peerless(rows: Iterable[Row]) -> Iterator[str]:
    """Groups without a peer, and why."""
    for group, found in grouped(rows):
        if not any(row.peer for row in found):
            yield f"- {group}: {next((row.no_peer for row in found if row.no_peer), 'nobody has said why')}"


def table_of_runs(rows: Sequence[Row], runs: Sequence[dict[str, str]]) -> Iterator[str]:
    """The runs that the numbers are from, the newest last."""
    yield from ("| commit, date | processor | Python | benchmarks |", "|---|---|---|---|")
    for run in runs:
        count = sum(row.run == run["run"] for row in rows)
        yield f"| {run['run']} | {run['processor']} | {run['python']} | {count} |"


def page_of(page: str, rows: Sequence[Row], runs: Sequence[dict[str, str]]) -> str:
    """The page with what is made put between its marks; `times rest` has the modules that no other table names."""
    named = {module for _, part, modules, _ in PART.findall(page) for module in modules.split() if part == "times"}
    there = {path.stem.removeprefix("test_bench_") for path in (ROOT / "tests/benchmarks").rglob("test_bench_*.py")}
    if unknown := named - there - {"rest"}:
        raise ValueError(f"the page asks for {', '.join(sorted(unknown))}: there is no test_bench_NAME.py of that name")
    counts = Counter(row.run for row in rows)
    most = counts.most_common(1)[0][0] if counts else ""

    def made(part: re.Match[str]) -> str:
        modules = set(part[3].split())
        if "rest" in modules:
            modules |= {row.module for row in rows} - named
        makers = {
            "times": lambda: times([row for row in rows if row.module in modules], most),
            "growth": lambda: growth(rows),
            "peerless": lambda: peerless(rows),
            "runs": lambda: table_of_runs(rows, runs),
        }
        if part[2] not in makers:
            raise ValueError(f"the page asks for {part[2]}, of {', '.join(makers)}")
        return part[1] + "\n".join(makers[part[2]]()) + "\n" + part[4]

    return PART.sub(made, page)


# ---------------------------------------------------------------------------------------------------------- the command
def main(arguments: Sequence[str] | None = None, folder: Path = HERE) -> int:
    """Measure, keep and write."""
    parser = argparse.ArgumentParser(description=str(__doc__), formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("benchmarks", nargs="*", help="files or node ids of pytest (all)")
    parser.add_argument("--long", action="store_true", help="those marked slow, instead of the short ones")
    parser.add_argument("--from", dest="files", nargs="*", type=Path, help="files of pytest --benchmark-json")
    told = parser.parse_args(arguments)
    texts, code = [file.read_text(encoding="utf-8") for file in told.files or ()], 0
    if told.files is None:
        marks = "slow or not slow" if told.benchmarks else "slow" if told.long else "not slow"
        with TemporaryDirectory() as scratch:
            out = Path(scratch) / "benchmarks.json"
            code = measure(["-m", marks, *(told.benchmarks or ["tests/benchmarks"])], out)
            texts = [out.read_text(encoding="utf-8")] if out.is_file() else []
    rows, runs = load(folder / "performance.json")
    for text in filter(None, texts):
        new, about = read(text)
        rows, runs = merged(rows, new), [run for run in runs if run["run"] != about["run"]] + [about]
    runs = [run for run in runs if any(row.run == run["run"] for row in rows)]
    page = folder / "performance.md"
    page.write_text(page_of(page.read_text(encoding="utf-8"), rows, runs), encoding="utf-8")
    save(folder / "performance.json", rows, runs)
    return code


if __name__ == "__main__":
    sys.exit(main())
