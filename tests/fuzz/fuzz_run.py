"""Fuzz the formats and the settings, as long as you like: uv run python tests/fuzz/fuzz_run.py --examples 20000

A worker, with 2 GB of memory more than it starts with, makes and uses one input after another and says what became of it;
one that dies or does not answer has failed on the input that it was at, and another goes on. An input is made from its name
alone: `--only mesh_obj:17` makes and uses it again, and leaves its files in --keep DIR.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

MEMORY = 2 * 2**30  # bytes that an input may take
PATIENCE_S = 700  # until a worker that says nothing has hung
START_S = 600  # which it may take to import and to compile
Report = tuple[str, int, str, str]  # family, number, verdict, text


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 1 if any input failed."""
    options = _parser().parse_args(argv)
    if options.worker:
        return _work(options.worker, options.first, options.examples)
    if options.only:
        return _again(options.only, options.keep)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # the table is printed all the same
    found: list[Report] = []
    try:
        for report in survey(options.family, options.first, options.examples):
            found.append(report)
            family, number, verdict, text = report
            if verdict == "failed":
                sys.stdout.write(f"--only {family}:{number}\n{text}\n\n")
                sys.stdout.flush()
    finally:
        sys.stdout.write(table(found))
    return int(any(verdict == "failed" for _, _, verdict, _ in found))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--examples", type=int, default=2000, help="inputs, shared out over the families (%(default)s)")
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first input of each family: others each time"
    )
    parser.add_argument(
        "--family", nargs="+", default=[], help="these only: formats, settings, runs, or their own names"
    )
    parser.add_argument("--only", metavar="FAMILY:NUMBER", help="one input")
    parser.add_argument(
        "--keep", type=Path, default=Path("fuzzed"), metavar="DIR", help="where --only leaves its files"
    )
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    return parser


def survey(chosen: Sequence[str], first: int, examples: int) -> Iterator[Report]:
    """Every input's verdict; the examples are shared out evenly, but slow families get a twentieth of a share.

    Where that is less than half an input, every fourth of them gets one.
    """
    from fuzz_families import FAMILIES, SLOW

    names = [name for name in FAMILIES if not chosen or name in chosen or name.partition("_")[0] in chosen]
    if unknown := [word for word in chosen if not any(word in {name, name.partition("_")[0]} for name in FAMILIES)]:
        raise SystemExit(f"there is no family {unknown[0]}; there is {', '.join(FAMILIES)}")
    weights = {name: 0.05 if name in SLOW else 1.0 for name in names}
    slow = [name for name in names if name in SLOW]
    for name in names:
        count = round(examples * weights[name] / sum(weights.values()))
        if count or name not in slow or slow.index(name) % 4 == 0:
            yield from _supervised(name, first, max(1, count))


def _supervised(name: str, first: int, count: int) -> Iterator[Report]:
    """The verdicts of a family's inputs, by as many workers as it takes."""
    at, end = first, first + count
    while at < end:
        worker = _worker(name, at, end - at)
        for line in _lines(worker):
            report: Report = tuple(json.loads(line))  # type: ignore[assignment]
            at = report[1] + 1
            yield report
        worker.kill()
        code = worker.wait()
        if at < end:
            yield name, at, "failed", f"the worker died, or did not answer for {PATIENCE_S} s (exit code {code})"
            at += 1


def _worker(name: str, first: int, count: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, __file__, "--worker", name, "--first", str(first), "--examples", str(count)]
    threads = dict.fromkeys(["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MALLOC_ARENA_MAX"], "1")
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=os.environ | threads)


def _lines(worker: subprocess.Popen[bytes]) -> Iterator[bytes]:
    assert worker.stdout is not None
    patience = START_S
    while select.select([worker.stdout], [], [], patience)[0]:
        if not (line := worker.stdout.readline()).endswith(b"\n"):
            return
        yield line
        patience = PATIENCE_S


def _work(name: str, first: int, count: int) -> int:
    """A worker: one line of JSON an input, on what was standard output; libraries write into the void."""
    out = os.fdopen(os.dup(1), "w")
    void = os.open(os.devnull, os.O_WRONLY)
    os.dup2(void, 1)
    from fuzz_engine import SECONDS, outcome_of
    from fuzz_families import FAMILIES, SLOW

    seconds = 600 if name in SLOW else SECONDS
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        use = FAMILIES[name](Path(folder) / "input")
        _limit_memory()
        for number in range(first, first + count):
            found = outcome_of(lambda number=number: use(f"{name}:{number}"), seconds)  # type: ignore[misc]
            out.write(json.dumps([name, number, found.verdict, found.text]) + "\n")
            out.flush()
    return 0


def _limit_memory() -> None:
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY, now + MEMORY))


def _again(only: str, keep: Path) -> int:
    from fuzz_engine import outcome_of
    from fuzz_families import FAMILIES

    name, _, number = only.rpartition(":")
    keep = keep.resolve()
    with contextlib.chdir(tempfile.mkdtemp()):
        use = FAMILIES[name](keep)
        found = outcome_of(lambda: use(f"{name}:{number}"))
    sys.stdout.write(f"{found.verdict}: {found.text}\n")
    return int(found.verdict == "failed")


def table(found: Sequence[Report]) -> str:
    """Counts by family and verdict."""
    counts = Counter((family, verdict) for family, _, verdict, _ in found)
    families = dict.fromkeys(family for family, _, _, _ in found)
    rows = [(family, *(counts[family, verdict] for verdict in ("ok", "refused", "failed"))) for family in families]
    rows.append(("all", *(sum(row[i] for row in rows) for i in (1, 2, 3))))
    return "".join(
        f"{name:<24}{a:>8}{b:>9}{c:>8}\n" for name, a, b, c in [("inputs", "ok", "refused", "failed"), *rows]
    )


if __name__ == "__main__":
    start = time.monotonic()
    code = main()
    sys.stderr.write("" if "--worker" in sys.argv else f"{time.monotonic() - start:.0f} s\n")
    sys.exit(code)
