"""Torture omnilab, as long as you like: uv run python tests/torture/torture_run.py --kill 300 --instant 100 --seed 5

Commands are killed, interrupted, or left without disk, pipes or names for processes, and what they leave is compared with
what is promised (docs/reliability.md). A case is made from its name alone: `--only kill:5-17` makes it again, and leaves its
files in --keep DIR.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from random import Random

sys.path.insert(0, str(Path(__file__).parent))

from torture_commands import Skipped, preload, warm, why_not

Report = tuple[str, str, str]  # name of the case, verdict, text


def main() -> int:
    """Exit code 1 if any promise was broken."""
    if reason := why_not():
        sys.stderr.write(f"{reason}\n")
        return 77
    preload()
    from torture_families import FAMILIES

    options = _parser(list(FAMILIES)).parse_args()
    names = options.only or [
        f"{family}:{options.seed}-{number}" for family in FAMILIES for number in range(getattr(options, family))
    ]
    found = []
    folder = Path(tempfile.mkdtemp(prefix="torture-"))  # whose removal the commands, our forks, must not inherit
    os.environ["TORTURE_FOLDER"] = str(folder)
    _warm(folder)
    for name in names:
        found.append(report := outcome(name, options.keep or folder))
        sys.stdout.write("\t".join([*report[:2], report[2].replace("\n", "\n    ")]) + "\n")
        sys.stdout.flush()
    shutil.rmtree(folder)
    sys.stdout.write(table(found))
    return int(any(verdict == "broken" for _, verdict, _ in found))


def _parser(families: Sequence[str]) -> argparse.ArgumentParser:
    from torture_families import FAMILIES

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for family in families:
        summary = (FAMILIES[family].__doc__ or "").splitlines()[0]
        parser.add_argument(f"--{family}", type=int, default=0, metavar="CASES", help=summary)
    parser.add_argument("--seed", type=int, default=0, help="other cases each (%(default)s)")
    parser.add_argument("--only", nargs="+", metavar="FAMILY:SEED-NUMBER", help="these cases")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="leave the files of all cases there")
    return parser


def _warm(folder: Path) -> None:
    from torture_scenarios import TINY

    (folder / "warm").mkdir()
    warm(folder / "warm", *TINY)


def outcome(name: str, keep: Path) -> Report:
    """Make a case; `kept`, `broken` or `skipped`, with what is broken or why."""
    from torture_families import FAMILIES

    folder = keep.resolve() / name.replace(":", "-")
    folder.mkdir(parents=True)
    try:
        family, number = re.fullmatch(r"(\w+):\d+-(\d+)", name).groups()
        broken = list(FAMILIES[family](int(number), Random(name), folder / "here"))
    except Skipped as reason:
        return name, "skipped", str(reason)
    except Exception:  # noqa: BLE001  a failure of the case
        broken = [traceback.format_exc()]
    if not broken:
        shutil.rmtree(folder)
    return name, "broken" if broken else "kept", "\n".join(broken)


def table(found: Sequence[Report]) -> str:
    """Counts by family and verdict."""
    counts = Counter((name.partition(":")[0], verdict) for name, verdict, _ in found)
    families = dict.fromkeys(family for family, _ in counts)
    rows = [(family, *(counts[family, verdict] for verdict in ("kept", "broken", "skipped"))) for family in families]
    rows.append(("all", *(sum(row[i] for row in rows) for i in (1, 2, 3))))
    return "".join(
        f"{name:<24}{a:>8}{b:>8}{c:>9}\n" for name, a, b, c in [("cases", "kept", "broken", "skipped"), *rows]
    )


if __name__ == "__main__":
    start = time.monotonic()
    code = main()
    sys.stderr.write(f"{time.monotonic() - start:.0f} s\n")
    sys.exit(code)
