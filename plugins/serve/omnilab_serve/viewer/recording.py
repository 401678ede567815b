"""A run's recording as a stream, which goes on for as long as the run does."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress
from io import FileIO
from pathlib import Path

from starlette.concurrency import run_in_threadpool

from omnilab.errors import DataError
from omnilab.runner.run_folder import RUNNING, LoadedRun
from omnilab_serve.run_details.files import RECORDING, open_file

CHUNK = 1 << 18  # bytes
LOOK_S = 0.2  # how often a recording that grows is looked at


async def follow(folder: Path, is_gone: Callable[[], Awaitable[bool]]) -> AsyncIterator[bytes]:
    """What a run's recording holds, then what is appended, until the run has ended, or nobody reads any more.

    What a run that was killed has written last may be a part of a message, which the viewer leaves out.
    """
    file: FileIO | None = None
    try:
        while not await is_gone():
            goes_on = await run_in_threadpool(
                _goes_on, folder
            )  # asked first: nothing is written between end and reading
            if file is None:
                with suppress(OSError):  # a run that has only begun
                    file = await run_in_threadpool(open_file, folder / RECORDING)
            while file and (part := await run_in_threadpool(file.read, CHUNK)):
                yield part
            if not goes_on:
                return
            await asyncio.sleep(LOOK_S)
    finally:
        if file:
            file.close()


def _goes_on(folder: Path) -> bool:
    try:
        return LoadedRun(folder).state == RUNNING
    except DataError:  # it was removed, or damaged
        return False
