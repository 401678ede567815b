"""The families of cases. A case, made from its name alone, disturbs a command and gives sentences about broken promises."""

from __future__ import annotations

import errno
import os
import resource
import signal
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from random import Random

import torture_promises as promises
from torture_commands import Ended, Fault, run
from torture_scenarios import ENDLESS, SCENARIOS, Scenario

Case = Callable[[int, Random, Path], Iterator[str]]  # number, chance, a folder to make
SHORTAGES = (errno.ENOSPC, errno.EDQUOT)  # the disk takes nothing more, but what is reserved
ERRORS = (*SHORTAGES, errno.EIO, errno.EROFS, errno.EACCES)
HEARD = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def kill(number: int, rng: Random, here: Path) -> Iterator[str]:
    """SIGKILL at any operation on files, half way through it where it is a write."""
    scenario = _nth(list(SCENARIOS), number)
    fault = Fault("kill", rng.randint(1, len(scenario.operations)), torn=rng.random() < 0.5)
    scenario.prepare(here)
    ended = scenario.start(here, fault=fault).wait()
    if ended.code != -signal.SIGKILL:  # it was a process of the command's that was killed
        yield from within(scenario, fault, ended, promises.sentences(ended))
    yield from within(scenario, fault, ended, _after_kill(scenario, here, _last_ns(ended)))


def instant(number: int, rng: Random, here: Path) -> Iterator[str]:
    """SIGKILL at any instant, of the process or of its group."""
    scenario = (
        Scenario("endless", ENDLESS) if number % 2 else _nth(["sweep", "render", "map", "render_parallel"], number // 2)
    )
    scenario.prepare(here)
    command = scenario.start(here)
    command.runs(rng.uniform(0.1, 8))
    at = command.send(signal.SIGKILL, group=rng.random() < 0.5)
    ended = command.wait()
    killed = ended.code == -signal.SIGKILL
    after = SCENARIOS["map"] if scenario.name == "endless" else scenario
    yield from within(after, f"after {len(ended.operations)} operations", ended, _after_kill(after, here, at * killed))


def _after_kill(scenario: Scenario, here: Path, killed_ns: int) -> Iterator[str]:
    """Nothing is lost, nothing blocks what comes next."""
    promises.plant_in_dataset(here)
    planted = promises.planted(here)
    yield from promises.torn_files(here)
    yield from promises.listing(here, "killed", "done", "failed")
    yield from promises.wrong_metrics(here, scenario.metrics)
    yield from promises.mended_logs(here, killed_ns)
    yield from _again(scenario, here)
    yield from promises.torn_files(here)
    yield from promises.listing(here, "killed", "done", "failed")
    for path in sorted(planted - promises.planted(here)):
        yield f"the user's {path} was touched"


def _again(scenario: Scenario, here: Path) -> Iterator[str]:
    """The same command again, which nothing disturbs, does all that it should."""
    again = run(here, *scenario.command)
    if again.code or "Traceback" in again.stderr:
        yield f"the same command again: {again.said}"
    elif scenario.is_experiment:
        yield from promises.differences(promises.results(here), scenario.results)
        yield from promises.latest(here)


def heard(number: int, rng: Random, here: Path) -> Iterator[str]:
    """SIGINT, SIGTERM or SIGHUP at any operation, or at any instant: a true status, whole logs, the metrics if computed."""
    scenario = _nth(["map", "run", "sweep", "render", "warm"], number)
    sent = rng.choice(HEARD)
    fault = Fault("signal", rng.randint(1, len(scenario.operations)), sent) if rng.random() < 0.7 else None
    scenario.prepare(here)
    command = scenario.start(here, fault=fault)
    if fault is None:
        command.runs(rng.uniform(0.1, 6))
        command.send(sent)
    yield from within(scenario, fault or sent, ended := command.wait(), _after_signal(scenario, here, ended))


def _after_signal(scenario: Scenario, here: Path, ended: Ended) -> Iterator[str]:
    if ended.code not in {0, 130}:
        yield f"ended with {ended.code}: {ended.said}"
    yield from promises.sentences(ended)
    yield from promises.torn_files(here)
    yield from promises.listing(here, "done", "interrupted")
    yield from promises.wrong_metrics(here, scenario.metrics)
    for found in promises.runs_of(here):
        yield from promises.unreadable_logs(found.folder)
        if found.state == "done" and ended.code == 0 and not _printed(ended):
            yield f"done, and no metrics on standard output: {ended.said}"
    yield from _again(scenario, here)


def full(number: int, rng: Random, here: Path) -> Iterator[str]:
    """The disk takes nothing more, or fails, from any operation on."""
    scenario = _nth(["map", "run", "sweep", "render", "warm", "cleaning", "localize"], number)
    error = rng.choice(ERRORS)
    fault = Fault("fail", rng.randint(1, len(scenario.operations)), error, torn=rng.random() < 0.5)
    scenario.prepare(here)
    ended = scenario.start(here, fault=fault).wait()
    yield from within(scenario, fault, ended, after_shortage(scenario, here, ended, error in SHORTAGES))


def cacheless(number: int, rng: Random, here: Path) -> Iterator[str]:
    """The cache cannot be written, from any operation on: no run pays for it."""
    scenario = _nth(["map", "warm", "cleaning", "sweep"], number)
    count = sum("logs/cache" in operation.path for operation in scenario.operations)
    fault = Fault("fail", rng.randint(1, count + 1), rng.choice(ERRORS), rng.random() < 0.5, "logs/cache")
    scenario.prepare(here)
    ended = scenario.start(here, fault=fault).wait()
    yield from within(scenario, fault, ended, _after_pipes(scenario, here, ended, float("inf")))


def limited(number: int, rng: Random, here: Path) -> Iterator[str]:
    """No file may grow beyond a size (RLIMIT_FSIZE)."""
    scenario = _nth(["map", "run", "sweep", "render"], number)
    size = int(10 ** rng.uniform(1, 5.5))
    scenario.prepare(here)

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    ended = scenario.start(here, before=limit).wait()
    yield from within(scenario, f"at most {size} bytes", ended, after_shortage(scenario, here, ended, True))


def after_shortage(
    scenario: Scenario, here: Path, ended: Ended, is_true: bool, make_room: Callable[[], object] = lambda: None
) -> Iterator[str]:
    """One sentence, 2 or a whole result, the metrics once they were computed; a true status where it was reserved."""
    if ended.code not in ({0, 1, 2} if scenario.name == "sweep" else {0, 2}):
        yield f"ended with {ended.code}: {ended.said}"
    yield from promises.sentences(ended)
    began = any(operation.path.endswith(("run.mcap", "run.rrd")) for operation in ended.operations)
    if (ended.code == 0 or (began and scenario.name not in {"render", "sweep"})) and not _printed(ended):
        yield f"no metrics on standard output: {ended.said}"
    yield from promises.torn_files(here)
    yield from promises.wrong_metrics(here, scenario.metrics)
    states = {found.state for found in promises.runs_of(here)}
    allowed = {"done", "failed"} if is_true else {"done", "failed", "killed"}
    if states - allowed:
        yield f"runs are {', '.join(sorted(states))}: {ended.said}"
    make_room()
    yield from _again(scenario, here)


def pipes(number: int, rng: Random, here: Path) -> Iterator[str]:
    """Whoever reads standard output or standard error goes away, after any number of bytes."""
    scenario = _nth(["map", "run", "sweep", "render"], number)
    reads = [float("inf"), float("inf")]
    for pipe in rng.choice([[0], [1], [0, 1]]):
        reads[pipe] = rng.choice([0, 1, 10, rng.randint(1, 200), rng.randint(1, 2000)])
    scenario.prepare(here)
    ended = scenario.start(here, reads=tuple(reads)).wait()
    yield from within(scenario, f"reads {reads}", ended, _after_pipes(scenario, here, ended, reads[0]))


def _after_pipes(scenario: Scenario, here: Path, ended: Ended, stdout: float) -> Iterator[str]:
    if ended.code not in {0, 1, 2}:
        yield f"ended with {ended.code}: {ended.said}"
    yield from promises.sentences(ended)
    yield from promises.torn_files(here)
    yield from promises.listing(here, "done")
    yield from promises.differences(promises.results(here), scenario.results)
    for found in promises.runs_of(here):
        yield from promises.unreadable_logs(found.folder)
    if stdout == float("inf") and not _printed(ended):
        yield f"no metrics on standard output: {ended.said}"


def _nth(names: Sequence[str], number: int) -> Scenario:
    """The scenarios of these names in turn."""
    return SCENARIOS[names[number % len(names)]]


def _printed(ended: Ended) -> bool:
    """Whether metrics are on standard output."""
    return any(name in ended.stdout for name in ("wrong_rate", "places", "images"))


def _last_ns(ended: Ended) -> int:
    """When the operation came at which it was killed; 0 where it ended by itself."""
    return ended.operations[-1].time_ns if ended.code == -signal.SIGKILL else 0


def within(scenario: Scenario, what: object, ended: Ended, broken: Iterator[str]) -> Iterator[str]:
    """Sentences that say where it happened."""
    last = ended.operations[-1] if ended.operations else None
    for sentence in broken:
        yield f"{scenario.name}, {what}, last {last and last.name} {last and os.path.relpath(last.path)}: {sentence}"
