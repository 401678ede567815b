"""Sweeps of jobs that are told how to end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

PLUGIN = Path(__file__).with_name("omnilab_jobs.py")
WORDS = "-m", "~experiment", "study=work", "~sinks.rerun", "~sinks.mcap", "hydra.sweep.dir=s"


@pytest.fixture
def work(omnilab_here, monkeypatch) -> Callable[..., object]:
    """`work(*overrides)`: a sweep of such jobs in tmp_path/s, in this process."""
    monkeypatch.setenv("OMNILAB_PLUGINS", str(PLUGIN))
    return lambda *overrides: omnilab_here(*WORDS, *overrides)


@pytest.fixture
def resumed(omnilab_here, monkeypatch) -> Callable[..., object]:
    """`resumed(*options)`: it goes on."""
    monkeypatch.setenv("OMNILAB_PLUGINS", str(PLUGIN))
    return lambda *options: omnilab_here("sweep", "resume", "s", *options)
