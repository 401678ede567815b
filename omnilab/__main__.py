"""The command `omnilab`, which is also `python -m omnilab`."""

from __future__ import annotations

import sys

from omnilab.runner.interrupts import uninterrupted
from omnilab.runner.streams import outlast


def main() -> None:
    """Import the command line, then do as it says."""
    outlast()
    try:
        with uninterrupted():
            from omnilab.runner.cli import main as command
    except KeyboardInterrupt:
        sys.exit(130)
    command()


if __name__ == "__main__":
    main()
