"""Cases of what is around a command: small disks, names of processes, other commands beside it, other ways to start it."""

from __future__ import annotations

import ctypes
import importlib.util
import json
import os
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

import torture_promises as promises
from torture_cases import after_shortage, within
from torture_commands import Command, Ended, Skipped, forked, run
from torture_scenarios import ENDLESS, RENDER, SCENARIOS, SWEEP, TINY, Scenario

NEW_MOUNTS, NEW_USER, NEW_PIDS = 0x20000, 0x10000000, 0x20000000  # of unshare(2)
PRIVATE, REMOUNT = 0x44000, 0x20  # of mount(2): of all mounts; another size
ENOUGH = 64 * 2**20  # bytes
RUNS_OF_BEFORE = Path(__file__).parents[1] / "data" / "runs_0_1"  # whose settings make small runs
EXPERIMENTS = (
    "grid", "grid_disturbed", "altitude", "changes", "joint", "linearity", "local_map", "map", "robustness", "room",
    "steps", "topological_map",
)  # fmt: skip
LAUNCHER = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")


# ------------------------------------------------------------------------------------------------------- namespaces
def unshare(what: int) -> None:
    """Leave namespaces, this process alone (one without other threads); Skipped where that is not allowed."""
    libc = ctypes.CDLL(None, use_errno=True)
    uid, gid = os.geteuid(), os.getegid()
    if libc.unshare(what | (0 if uid == 0 else NEW_USER)):
        raise Skipped(f"no namespaces of our own: {os.strerror(ctypes.get_errno())}")
    if uid != 0:
        for name, text in (("setgroups", "deny"), ("uid_map", f"0 {uid} 1"), ("gid_map", f"0 {gid} 1")):
            Path("/proc/self", name).write_text(text)
    if what & NEW_MOUNTS:
        mount("none", "/", None, PRIVATE)


def mount(source: str, target: str | Path, kind: str | None, flags: int = 0, options: str | None = None) -> None:
    """As mount(2); Skipped where that is not allowed."""
    libc = ctypes.CDLL(None, use_errno=True)
    texts = (text and str(text).encode() for text in (source, target, kind))
    if libc.mount(*texts, ctypes.c_ulong(flags), options and options.encode()):
        raise Skipped(f"no mounts of our own: {os.strerror(ctypes.get_errno())}")


def disk(number: int, rng: Random, here: Path) -> Iterator[str]:
    """A disk of its own (tmpfs) with room for any number of bytes."""
    scenario = SCENARIOS[("map", "run", "sweep", "render", "warm", "cleaning")[number % 6]]
    room = int(10 ** rng.uniform(3, 6.2))
    assert scenario.results  # made here, on the large disk

    def broken() -> list[str]:
        unshare(NEW_MOUNTS)
        here.mkdir(parents=True)
        mount("tmpfs", here, "tmpfs", 0, f"size={ENOUGH}")
        scenario.prepare(here)
        used = shutil.disk_usage(here).used
        mount("tmpfs", here, "tmpfs", REMOUNT, f"size={used + room}")
        ended = scenario.start(here).wait()

        def make_room() -> None:
            mount("tmpfs", here, "tmpfs", REMOUNT, f"size={ENOUGH}")

        return list(within(scenario, f"{room} bytes", ended, after_shortage(scenario, here, ended, True, make_room)))

    yield from forked(broken)


def contained() -> None:
    """Go on as process 1 of a namespace; this process waits for it."""
    unshare(NEW_PIDS | NEW_MOUNTS)
    if pid := os.fork():
        _, status = os.waitpid(pid, 0)
        code = os.waitstatus_to_exitcode(status)
        os._exit(code if code >= 0 else 128 - code)


def contained_with_proc() -> None:
    """The same, where /proc shows the new namespace."""
    contained()
    mount("proc", "/proc", "proc")


def pids(number: int, rng: Random, here: Path) -> Iterator[str]:
    """A run in another PID namespace, while it lives and once it was killed, seen from here or from a third one."""
    inner, outer = VIEWS[number % len(VIEWS)]
    forked(contained_with_proc)  # Skipped where we may not
    Scenario("endless", ENDLESS).prepare(here)
    command = Command(here, *ENDLESS, before=inner)
    for name in ("logs/latest/run.mcap", "logs/latest/run.rrd"):
        _until(command, lambda name=name: (here / name).exists() and (here / name).stat().st_size > 5000)  # type: ignore[misc]
    command.runs(rng.uniform(0, 3))
    for argv in (("repair", "logs/latest"), ("runs",)):
        said = run(here, *argv, before=outer)
        if argv == ("runs",) and ("running" not in said.stdout or said.code):
            yield f"a living run of another namespace is not shown as running: {said.said}"
        if argv != ("runs",) and said.code != 2:
            yield f"{argv[0]} of a living run of another namespace: {said.said}"
    if not command.runs(1.5):
        yield f"the run has ended: {command.wait().said}"
        return
    at = command.send(signal.SIGKILL, group=True)
    command.wait()
    said = run(here, "runs", before=outer)
    if "running" in said.stdout or said.code:
        yield f"the run was killed: {said.said}"
    yield from promises.mended_logs(here, at)
    yield from promises.torn_files(here)


def _nothing() -> None:
    """Stay in the same namespaces."""


VIEWS = (  # from where a run is made, and seen
    (contained, _nothing),
    (contained_with_proc, contained),
    (_nothing, contained_with_proc),
    (contained, contained),
    (_nothing, contained),
    (contained_with_proc, _nothing),
)


def _until(command: Command, there: Callable[[], bool]) -> None:
    """Wait; RuntimeError if the command ends before."""
    while not there():
        if not command.runs(0.1):
            raise RuntimeError(f"it ended: {command.wait().said}")


# --------------------------------------------------------------------------------------------------------- together
def together(number: int, rng: Random, here: Path) -> Iterator[str]:
    """Commands at the same time in one folder, none of which pays for another."""
    kinds = (_runs, _sweeps, _renders, _repairs, _lists)
    SCENARIOS["run"].prepare(here)
    planted = promises.planted(here)
    yield from kinds[number % len(kinds)](rng, here)
    yield from promises.torn_files(here)
    yield from promises.listing(here, "killed", "done")
    yield from (f"the user's {path} was touched" for path in planted - promises.planted(here))


def _runs(rng: Random, here: Path) -> Iterator[str]:
    """Four at once, with one cold cache."""
    commands = [Command(here, *TINY) for _ in range(4) if time.sleep(rng.uniform(0, 0.3)) is None]
    yield from _ended_well(commands)
    yield from promises.wrong_metrics(here, SCENARIOS["run"].metrics)
    yield from promises.differences(promises.results(here), SCENARIOS["run"].results)


def _sweeps(rng: Random, here: Path) -> Iterator[str]:
    commands = [Command(here, *SWEEP) for _ in range(2) if time.sleep(rng.uniform(0, 0.3)) is None]
    yield from _ended_well(commands)
    yield from promises.wrong_metrics(here, SCENARIOS["sweep"].metrics)
    for summary in (here / "logs").rglob("summary.csv"):
        if summary.read_text().count(",done,") != 3:
            yield f"{summary}: {summary.read_text()}"


def _renders(rng: Random, here: Path) -> Iterator[str]:
    """Two into one folder: they share the work, or one is told."""
    commands = [Command(here, *RENDER) for _ in range(2) if time.sleep(rng.uniform(0, 0.3)) is None]
    ended = [command.wait() for command in commands]
    if sorted(each.code for each in ended) not in ([0, 0], [0, 2]):
        yield " and ".join(each.said for each in ended)
    for each in ended:
        yield from promises.sentences(each)
    data = {name: data for name, data in promises.results(here).items() if name.startswith("set/")}
    yield from promises.differences(
        data, {n: d for n, d in SCENARIOS["render"].results.items() if n.startswith("set/")}
    )


def _repairs(rng: Random, here: Path) -> Iterator[str]:
    """A run that lives is not mended, again and again."""
    command = Command(here, *ENDLESS)
    _until(command, (here / "logs/latest/run.mcap").exists)
    for _ in range(3):
        said = run(here, "repair", "logs/latest")
        if said.code != 2:
            yield f"repair of a living run: {said.said}"
        command.runs(rng.uniform(0, 1))
    command.send(signal.SIGINT)
    ended = command.wait()
    if ended.code != 130:
        yield ended.said
    (interrupted,) = promises.runs_of(here)
    yield from promises.unreadable_logs(interrupted.folder)
    if interrupted.state != "interrupted":
        yield f"the run is {interrupted.state}"
    shutil.rmtree(interrupted.folder)


def _lists(rng: Random, here: Path) -> Iterator[str]:
    """`omnilab runs` while runs are made and removed."""
    before = run(here, *TINY)
    commands = [Command(here, *TINY) for _ in range(2)]
    first = promises.runs_of(here)[0].folder
    shutil.copytree(first, first.with_name("copied"))
    removing = Command(here, "runs", before=lambda: shutil.rmtree(first.with_name("copied")))
    listing = [Command(here, "runs") for _ in range(3) if time.sleep(rng.uniform(0, 0.5)) is None]
    yield from _ended_well([*commands, *listing, removing])
    yield from promises.sentences(before)


def _ended_well(commands: list[Command]) -> Iterator[str]:
    for command in commands:
        ended = command.wait()
        if ended.code or "Traceback" in ended.stderr:
            yield ended.said


# --------------------------------------------------------------------------------------------------------- identity
def identity(number: int, rng: Random, here: Path) -> Iterator[str]:
    """An experiment, cold, warm, four at once, in a sweep, and by joblib's launcher: the same results, byte for byte."""
    name = EXPERIMENTS[number % len(EXPERIMENTS)]
    here.mkdir(parents=True)
    argv = settings_of(name)
    expected = _results_of(here, run(here, *argv, "cache=off"))
    for mode, more in (("cold", ()), ("warm", ())):
        yield from _alike(mode, _results_of(here, run(here, *argv, *more)), expected)
    commands = [Command(here, *argv, "cache=other") for _ in range(4)]
    for ended in [command.wait() for command in commands]:
        yield from _alike("four at once", _results_of(here, ended), expected)
    launchers: list[tuple[str, ...]] = [()]
    if importlib.util.find_spec("hydra_plugins") and importlib.util.find_spec("hydra_plugins.hydra_joblib_launcher"):
        launchers.append(LAUNCHER)
    for more in launchers:
        swept = run(here, "-m", *argv, "seed=0,1", *more)
        if swept.code:
            yield f"{name}, in a sweep {more}: {swept.said}"
        else:
            yield from _alike(
                f"in a sweep {more}", promises.results_of((here / "logs/latest").resolve().parent / "0"), expected
            )


def settings_of(name: str) -> list[str]:
    """Overrides of a small run of an experiment, by one that is kept."""
    overrides = json.loads((RUNS_OF_BEFORE / name / "manifest.json").read_text())["overrides"]
    kept = [override for override in overrides if "sink@" not in override and not override.startswith("cache=")]
    return [override.replace("box_world.yaml", str(RUNS_OF_BEFORE / "box_world.yaml")) for override in kept]


def _results_of(here: Path, ended: Ended) -> dict[str, bytes]:
    """Of a run that printed its folder."""
    if ended.code:
        raise RuntimeError(ended.said)
    return promises.results_of(here / ended.stdout.splitlines()[0])


def _alike(mode: str, found: dict[str, bytes], expected: dict[str, bytes]) -> Iterator[str]:
    yield from (f"{mode}: {sentence}" for sentence in promises.differences(found, expected))
