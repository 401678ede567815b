"""What is disturbed: commands that write something, each with what precedes it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torture_promises
import torture_witness
from torture_commands import Command, Fault, Operation, run

WORLD = Path(__file__).parents[1] / "box_world.yaml"
SENSOR = (f"sensor.world={WORLD}", "sensor.size=32", "sensor.samples=1")
TINY = (
    "experiment=quickstart", *SENSOR, "descriptor.offsets=24", "descriptor.angles=30", "study.step_m=0.8",
    "study.query_count=8", "study.show=2",
)  # fmt: skip
ENDLESS = (
    "experiment=quickstart", *SENSOR, "sensor.batch=8", "descriptor.offsets=24", "descriptor.angles=30",
    "study.step_m=0.5", "study.query_count=1000000", "study.show=1000000",
)  # fmt: skip
MAP = ("experiment=map", *SENSOR, "descriptor.offsets=24", "descriptor.angles=30", "study.step_m=0.8", "study.show=2")
RENDER = ("experiment=render", *SENSOR, "study.step_m=1.5", "study.folder=set", "study.show=2")
LOCALIZE = ("experiment=localize", *SENSOR, "map=maps/latest", "study.query_count=8", "study.show=2")
SWEEP = ("-m", *MAP, "seed=0,1,2")
KILLED = Fault("kill", 45)  # somewhere in the logs


@dataclass(frozen=True)
class Scenario:
    """A command, and others before it, which nothing disturbs but the given fault."""

    name: str
    command: Sequence[str]
    before: Sequence[tuple[Sequence[str], Fault | None]] = ()

    @property
    def is_experiment(self) -> bool:
        """Whether it makes runs of its own."""
        return self.command[0] not in {"repair", "repeat"}

    @property
    def argv(self) -> tuple[str, ...]:
        """The command, with a witness of what is logged."""
        return (*self.command, torture_witness.SINK) if self.is_experiment else tuple(self.command)

    def prepare(self, folder: Path) -> None:
        """A folder in which the command can be given."""
        folder.mkdir(parents=True, exist_ok=True)  # it may be a disk of its own
        torture_promises.plant(folder)
        for argv, fault in self.before:
            run(folder, *argv, fault=fault)

    def start(self, folder: Path, **more: object) -> Command:
        """Give the command."""
        return Command(folder, *self.argv, env=witness(folder), **more)  # type: ignore[arg-type]

    @cached_property
    def _reference(self) -> tuple[Sequence[Operation], dict[str, bytes], set[bytes]]:
        folder = Path(os.environ["TORTURE_FOLDER"]) / f"reference-{self.name}" / "here"
        self.prepare(folder)
        ended = self.start(folder).wait()
        if ended.code:
            raise RuntimeError(f"{self.name} does not end well undisturbed: {ended.said}")
        return ended.operations, torture_promises.results(folder), torture_promises.all_metrics(folder)

    @property
    def operations(self) -> Sequence[Operation]:
        """What the command does when nothing disturbs it."""
        return self._reference[0]

    @property
    def results(self) -> dict[str, bytes]:
        """What it computes when nothing disturbs it."""
        return self._reference[1]

    @property
    def metrics(self) -> set[bytes]:
        """Every `metrics.csv` that there is then."""
        return self._reference[2]


def witness(folder: Path) -> dict[str, str]:
    """Environment of a command with a witness."""
    plugin = Path(torture_witness.__file__)
    return {"OMNILAB_PLUGINS": str(plugin), torture_witness.VARIABLE: str(folder.parent / "witness")}


SCENARIOS = {
    scenario.name: scenario
    for scenario in (
        Scenario("map", MAP),
        Scenario("run", TINY),
        Scenario("sweep", SWEEP),
        Scenario("warm", MAP, [(MAP, None)]),
        Scenario("cleaning", (*MAP, "cache_gb=1e-6", "descriptor.angles=36"), [(MAP, None)]),
        Scenario("localize", LOCALIZE, [((*MAP, "logs=maps"), None)]),
        Scenario("render", RENDER),
        Scenario("render_again", RENDER, [(RENDER, Fault("kill", 60))]),
        Scenario("render_parallel", (*RENDER, "study.step_m=0.4", "study.processes=2")),
        Scenario("repair", ("repair", "logs/latest"), [(MAP, KILLED)]),
        Scenario("repeat", ("repeat", "maps/latest"), [((*MAP, "logs=maps"), None)]),
    )
}
