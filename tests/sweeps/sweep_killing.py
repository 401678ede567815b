"""Kill a sweep again and again, resume it, and compare what it comes to with one that was left alone.

uv run python tests/sweeps/sweep_killing.py --launcher serial joblib submitit --jobs 24 --kills 10 --seed 1
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from random import Random

SCRIPT = Path(sys.executable).with_name("omnilab")
PLUGIN = Path(__file__).with_name("omnilab_jobs.py")
LAUNCHERS = {
    "serial": [],
    "joblib": ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"],
    "submitit": ["hydra/launcher=submitit_local", "hydra.launcher.timeout_min=10"],
    "ray": ["hydra/launcher=ray", "+hydra.launcher.ray.init.num_cpus=2"],
}
WORDS = "-m", "~experiment", "study=work", "~sinks.rerun", "~sinks.mcap"
LONGEST_S = 900.0


def command(folder: Path, *words: str) -> subprocess.Popen[bytes]:
    """The installed command in a session of its own, whose processes can be killed together."""
    env = os.environ | {"OMNILAB_PLUGINS": str(PLUGIN)}
    with (folder / "output.txt").open("ab") as log:
        return subprocess.Popen(
            [SCRIPT, *words], cwd=folder, env=env, stdout=log, stderr=log, stdin=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip


def lines(folder: Path) -> int:
    """How many events the sweep has seen."""
    file = folder / "s" / "jobs.jsonl"
    return file.read_bytes().count(b"\n") if file.exists() else 0


def results(sweep: Path) -> dict[str, bytes]:
    """What must be the same, byte for byte: the table, and the metrics of every job."""
    files = [sweep / "summary.csv", *sorted(sweep.glob("[0-9]*/metrics.csv"))]
    return {str(file.relative_to(sweep)): file.read_bytes() for file in files}


def left_alone(folder: Path, values: str, launcher: str, wait_s: float) -> dict[str, bytes]:
    """The results of the sweep that nobody kills, run one job after the other."""
    folder.mkdir()
    sweep = command(folder, *WORDS, values, f"study.wait_s={wait_s}", "hydra.sweep.dir=s", *LAUNCHERS[launcher])
    assert sweep.wait(LONGEST_S) == 0, (folder / "output.txt").read_text()[-3000:]
    return results(folder / "s")


def killed(
    folder: Path, values: str, launcher: str, wait_s: float, kills: int, random: Random, group: bool = True
) -> dict[str, bytes]:
    """The results of the sweep that is killed so often, at random instants, and resumed each time.

    `group`: all its processes are killed; else the first alone, whose workers may go on.
    """
    folder.mkdir()
    words = [*WORDS, values, f"study.wait_s={wait_s}", "hydra.sweep.dir=s", *LAUNCHERS[launcher]]
    for _ in range(kills):
        known = lines(folder)
        sweep = command(folder, *words)
        while sweep.poll() is None and lines(folder) == 0:
            time.sleep(0.05)  # before there is a plan, there is nothing to resume
        if random.random() < 0.7:  # some jobs later; else at any time, while it starts perhaps
            more = random.randint(2, 8)
            while sweep.poll() is None and lines(folder) < known + more:
                time.sleep(0.02)
        time.sleep(random.uniform(0.0, 1.5))
        with suppress(ProcessLookupError):  # it may be done by now
            os.killpg(sweep.pid, signal.SIGKILL) if group else sweep.kill()
        sweep.wait()
        words = ["sweep", "resume", "s"]
    sweep = command(folder, *words)
    assert sweep.wait(LONGEST_S) == 0, (folder / "output.txt").read_text()[-3000:]
    return results(folder / "s")


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 1 if anything differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--launcher", nargs="+", choices=LAUNCHERS, default=["serial"])
    parser.add_argument("--jobs", type=int, default=24)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--wait", type=float, default=1.0, help="seconds that each job takes at least (%(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--parent", action="store_true", help="kill the first process alone, not its workers")
    options = parser.parse_args(argv)
    values, worst = f"study.value=range(0,{options.jobs})", 0
    with tempfile.TemporaryDirectory(prefix="sweep-killing-") as name:
        expected = left_alone(Path(name) / "alone", values, "serial", 0.0)
        for launcher in options.launcher:
            start, random = time.monotonic(), Random(f"{options.seed} {launcher}")
            folder = Path(name) / launcher
            found = killed(folder, values, launcher, options.wait, options.kills, random, not options.parent)
            cut_off = len(list((folder / "s").glob("attempts/*")))
            same = without_wait(found) == without_wait(expected)
            worst |= not same
            sys.stdout.write(
                f"{launcher}: {options.jobs} jobs, {options.kills} kills, {cut_off} jobs cut off,"
                f" {'the same' if same else 'DIFFERENT'}, {time.monotonic() - start:.0f} s\n"
            )
            sys.stdout.flush()
    return worst


def without_wait(found: dict[str, bytes]) -> dict[str, list[bytes]]:
    """Results without the column of the time that jobs waited."""
    header = found["summary.csv"].splitlines()[0].split(b",")
    at = header.index(b"study.wait_s")
    table = [
        b",".join(cell for i, cell in enumerate(line.split(b",")) if i != at)
        for line in found["summary.csv"].splitlines()
    ]
    return {name: content.splitlines() for name, content in found.items()} | {"summary.csv": table}


if __name__ == "__main__":
    sys.exit(main())
