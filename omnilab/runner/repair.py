"""Mending the logs of runs that were killed, by the sinks that wrote them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from omnilab.runner.run_folder import KILLED, LoadedRun, RunFolder, load_run
from omnilab.runner.terminal import print_error

if TYPE_CHECKING:
    from omnilab.runner.registry import Registry


class RunsOnDisk:
    """The runs on disk, for commands of plugins: see `omnilab.hooks.Runs`."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry

    def ready(self, run: Path) -> Path:
        """The folder of a run, its logs mended first if it was killed; DataError if there is none."""
        loaded = load_run(run)
        if loaded.state == KILLED:
            mend(loaded, self._registry)
        return loaded.folder


def mend(run: LoadedRun, registry: Registry) -> list[str]:
    """Every sink's repair of a run's files: what was done, in sentences, which are printed."""
    done = [s for name in registry.names("sink") if (s := registry.get("sink", name).cls().repair(run.folder))]
    for sentence in done:
        print_error(sentence)
    if run.state == KILLED:
        RunFolder(run.folder).status(KILLED)
    return done
