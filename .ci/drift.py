"""How the time of each short benchmark changed since a commit, as a ratio: .ci/drift [BASE] [--passes 4] [BENCHMARKS]

Both are measured in this one run, in turn: base, now, now, base, ..., by processor time and in one thread, so that what the
machine does else comes upon both. The benchmarks are those of now, on the code of both. A ratio is now / base, of the least
time of each pass, with Student's interval of 95 % over the passes' logarithms. It informs: the exit code tells only whether
it could be measured.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.stats import t

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))
from performance import load, measure

LIMIT = 1.15
SHORT_S = 1.0  # that all rounds of a benchmark took when the page was made
Times = Mapping[str, float]


def in_turn(base: Callable[[], Times], now: Callable[[], Times], passes: int) -> dict[str, list[tuple[float, float]]]:
    """Times (base, now) of what both could run, by test, a pair for each pass; who begins changes with every pass."""
    pairs: dict[str, list[tuple[float, float]]] = {}
    for turn in range(passes):
        before, after = (base(), now()) if turn % 2 == 0 else (now(), base())[::-1]
        for test in before.keys() & after.keys():
            pairs.setdefault(test, []).append((before[test], after[test]))
    return {test: found for test, found in sorted(pairs.items()) if len(found) == passes}


def ratio_of(pairs: Sequence[tuple[float, float]]) -> tuple[float, float, float]:
    """The geometric mean of now / base, and the ends of its interval of 95 %: of no width is one of no spread."""
    logs = np.log([after / before for before, after in pairs])
    half = t.ppf(0.975, len(logs) - 1) * logs.std(ddof=1) / len(logs) ** 0.5
    return tuple(float(np.exp(end)) for end in (logs.mean(), logs.mean() - half, logs.mean() + half))


def verdict(ratio: float, low: float, high: float) -> str:
    """What to call it: surely beyond the limit, perhaps, or nothing."""
    way = "slower" if ratio > 1 else "faster"
    if low > LIMIT or high < 1 / LIMIT:
        return way
    return f"perhaps {way}" if not 1 / LIMIT <= ratio <= LIMIT else ""


def report(pairs: Mapping[str, Sequence[tuple[float, float]]], base: str) -> Iterator[str]:
    """All ratios, the greatest first, and below them those that are named."""
    found = sorted(((ratio_of(pairs[test]), test) for test in pairs), reverse=True)
    yield f"now / {base}, [interval of 95 %]"
    for (ratio, low, high), test in found:
        yield f"{ratio:6.2f}  [{low:.2f}, {high:.2f}]  {test}  {verdict(ratio, low, high)}".rstrip()
    named = [
        f"{verdict(*ratios)}: {test.partition('::')[2]} {ratios[0]:.2f}" for ratios, test in found if verdict(*ratios)
    ]
    yield f"beyond {LIMIT - 1:.0%}: " + ("; ".join(named) or "none") + f" (of {len(found)})"


def short(kept: Path) -> list[str]:
    """What pytest is told to run: all but what is marked slow, and what takes longer by docs/performance.json."""
    rows, _ = load(kept)
    return ["tests/benchmarks", "-m", "not slow", *(f"--deselect={row.test}" for row in rows if row.took_s > SHORT_S)]


@contextmanager
def checkout(commit: str, root: Path) -> Iterator[Path]:
    """A worktree of a commit with the benchmarks of now, beside what lies beside ours (../shared); gone afterwards."""
    git = ("git", "-C", str(root), "worktree")
    with TemporaryDirectory(prefix="drift-") as folder:
        tree = Path(folder) / "tree"
        subprocess.run([*git, "add", "--quiet", "--detach", tree, commit], check=True)
        try:
            (Path(folder) / "shared").symlink_to(root.parent / "shared")
            shutil.rmtree(tree / "tests/benchmarks", ignore_errors=True)
            shutil.copytree(root / "tests/benchmarks", tree / "tests/benchmarks")
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", tree], check=True)


def least_of(tests: Sequence[str], tree: Path, python: str) -> Times:
    """The least time of each benchmark in a checkout, seconds."""
    with TemporaryDirectory() as scratch:
        out = Path(scratch) / "benchmarks.json"
        measure(tests, out, tree, (python,))
        found = (
            json.loads(out.read_text(encoding="utf-8")) if out.is_file() and out.stat().st_size else {"benchmarks": []}
        )
    return {one["fullname"]: one["stats"]["min"] for one in found["benchmarks"]}


def main() -> int:
    """Measure both and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", nargs="?", default="HEAD~1", help="a commit (HEAD~1)")
    parser.add_argument("benchmarks", nargs="*", help="files or node ids of pytest (the short ones)")
    parser.add_argument("--passes", type=int, default=4, help="how often each is measured (4)")
    told = parser.parse_args()
    tests = told.benchmarks or short(ROOT / "docs/performance.json")
    uv = shlex.split(os.environ.get("UV", "python3 -m uv"))
    with checkout(told.base, ROOT) as tree:
        environment = {name: value for name, value in os.environ.items() if name != "VIRTUAL_ENV"}
        subprocess.run([*uv, "sync", "--frozen", "--quiet"], cwd=tree, env=environment, check=True)
        pairs = in_turn(
            lambda: least_of(tests, tree, str(tree / ".venv/bin/python")),
            lambda: least_of(tests, ROOT, sys.executable),
            told.passes,
        )
    sys.stdout.write("\n".join(report(pairs, told.base)) + "\n")
    return 0 if pairs else 1


if __name__ == "__main__":
    sys.exit(main())
