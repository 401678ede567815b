"""The fuzz suite's modules can be imported from here, and `--fuzz-examples` says how long it goes on."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--fuzz-examples", type=int, default=20, help="inputs of the slow part of tests/fuzz (%(default)s: minutes)"
    )
    parser.addoption(
        "--fuzz-first", type=int, default=0, help="number of the first input of each family: others each time"
    )
