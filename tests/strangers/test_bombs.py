"""What small files claim, or unpack to, is refused before it takes memory or time."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable
from multiprocessing.forkserver import ensure_running
from pathlib import Path

import bombs
import pytest

MOST = 700 << 20  # bytes that a reader may take for files of up to 64 MiB
READ = {"a.png: text of 2 GB", "a.png: profile of 2 GB", "a.glb: a chain of nodes"}  # as far as it is sound
READ |= {name for name in bombs.BOMBS if name.startswith("a.mcap")}
SLOW = {"a.mcap: zstd of 2 GB", "a.mcap: zstd that claims less", "a.ply: a face of 4e9", "a.obj: a huge index"}


@pytest.fixture(scope="module")
def processes():
    """From where processes fork that have imported all there is to import."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["bombs"])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(sys.path))  # it does not take over `sys.path`
        ensure_running()
    return context


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in bombs.BOMBS]
)
def test_a_bomb_is_a_sentence(
    name: str,
    tmp_path: Path,
    processes: multiprocessing.context.ForkServerContext,
    record_property: Callable[..., None],
) -> None:
    bombs.make(name, tmp_path)
    mine, theirs = processes.Pipe(duplex=False)
    process = processes.Process(target=bombs.read, args=(name, tmp_path, theirs))
    process.start()
    theirs.close()
    try:
        found, seconds, peak = mine.recv()
    except EOFError:
        process.join()
        pytest.fail(f"the process ended with code {process.exitcode}")
    process.join()
    record_property("took", f"{seconds:.1f} s, {peak >> 20} MiB: {found}")
    assert found.startswith("read" if name in READ else "sentence")
    assert peak < MOST
