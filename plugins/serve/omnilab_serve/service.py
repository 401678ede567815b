"""What pages and API share: the logs, the index of runs, the queue, and who is told of changes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from fastapi import Depends
from starlette.requests import HTTPConnection

from omnilab.errors import DataError
from omnilab.runner.run_folder import LoadedRun, load_run
from omnilab.runner.sweeps import LoadedSweep, load_sweep
from omnilab_serve.comparing import Comparisons
from omnilab_serve.composing import Composer
from omnilab_serve.events import Events
from omnilab_serve.index.run_index import RunIndex
from omnilab_serve.queue import RunQueue
from omnilab_serve.security.links import outward_link, sentence
from omnilab_serve.settings import ServeSettings
from omnilab_serve.sweeps import WatchedSweeps

PAINTER_IDLE_S = 20.0  # pictures are drawn once for each version


class NotThereError(DataError):
    """Nothing is there, or nothing that is shown."""


class Service:
    """The parts of a running service. All it knows is on the disk."""

    def __init__(self, settings: ServeSettings) -> None:
        self.settings = settings
        self.events = Events()
        self.comparisons = Comparisons(settings.logs)
        self.watched = WatchedSweeps()
        self.index = RunIndex(settings.logs, self.events)
        self.composer = Composer(settings)
        self.painter = Composer(settings, idle_s=PAINTER_IDLE_S)  # no form waits until all worlds are drawn
        self.queue = RunQueue(settings, self.events, self.composer)

    def start(self) -> None:
        """Begin to watch the logs, and to run what is in the queue."""
        self.index.start()
        self.queue.start()

    def stop(self) -> None:
        """End what was started; what runs goes on."""
        self.queue.stop()
        self.composer.stop()
        self.painter.stop()
        self.index.stop()

    def folder(self, path: str) -> Path:
        """A folder below the logs by its path; NotThereError for one elsewhere, links resolved."""
        logs = self.settings.logs.resolve()
        try:
            folder = (logs / path).resolve()
            is_there = folder.is_relative_to(logs) and folder != logs and folder.is_dir()
            link = outward_link(folder, logs) if is_there else None
        except (OSError, ValueError, RuntimeError):  # no name, not ours to read, a circle of links
            is_there = False
        if not is_there:
            raise NotThereError(f"there is no folder {path} in the logs")
        if link:
            raise NotThereError(sentence(path, link))
        return folder

    def path(self, folder: Path) -> str:
        """A folder's path below the logs, by which pages and API call it."""
        return folder.resolve().relative_to(self.settings.logs.resolve()).as_posix()

    def run(self, path: str) -> LoadedRun:
        """The run of a path; NotThereError if there is none."""
        folder = self.folder(path)
        try:
            return load_run(folder)
        except DataError as error:
            raise NotThereError(str(error)) from error

    def sweep(self, path: str) -> LoadedSweep:
        """The sweep of a path; NotThereError if there is none."""
        folder = self.folder(path)
        try:
            return load_sweep(folder)
        except DataError as error:
            raise NotThereError(str(error)) from error


def service_of(connection: HTTPConnection) -> Service:
    """The service of an application, for its routes."""
    found: Service = connection.app.state.service
    return found


Here = Annotated[Service, Depends(service_of)]
