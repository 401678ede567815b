"""Links in the folders of runs, which may lead to what their owner may not read."""

from __future__ import annotations

import os
from pathlib import Path


def outward_link(folder: str | Path, logs: Path) -> str | None:
    """The name of a link, anywhere below a folder, that leads out of the logs (resolved); None if there is none."""
    waiting = [str(folder)]
    while waiting:
        with os.scandir(waiting.pop()) as entries:
            for entry in entries:
                if entry.is_symlink():
                    if not _leads_into(entry.path, logs):
                        return entry.name
                elif entry.is_dir():
                    waiting.append(entry.path)
    return None


def sentence(folder: str, link: str) -> str:
    """What is said of such a folder."""
    return f"{folder} is not shown: '{link}' in it is a link that leads out of the logs; put the file itself there"


def _leads_into(link: str, logs: Path) -> bool:
    try:
        return Path(link).resolve().is_relative_to(logs)
    except (OSError, RuntimeError):  # a circle of links
        return False
