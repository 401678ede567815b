"""What a run's folder says of the run from its first moment on: `manifest.json`, as sinks and other programs read it."""

from __future__ import annotations

import json
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnilab.file_kinds import content_of

FILE = "manifest.json"
DEFAULT_RECIPE = "quickstart"  # as config.yaml has it
LARGEST_BYTES = 4 * 2**20


@dataclass(frozen=True)
class Manifest:
    """Which run this is. What a folder does not say is empty: scripts log without a runner."""

    id: str  # of this run alone, among all runs of all machines; without the folder's name it says nothing
    folder: Path  # absolute
    experiment: str = ""
    overrides: tuple[str, ...] = ()
    seed: int | None = None
    identity: str = ""  # the same for all runs of one configuration
    began: str = ""  # ISO 8601
    version: str = ""  # of omnilab
    commit: str = ""  # of the source tree it ran from, with "+changes" if that was edited

    @property
    def name(self) -> str:
        """The folder's name; of a job of a sweep, which is a number, with the sweep's before it."""
        folder = self.folder
        return f"{folder.parent.name}/{folder.name}" if folder.name.isdecimal() else folder.name

    @property
    def unique_name(self) -> str:
        """The name with the id: no other run has it, wherever its folder lies."""
        return f"{self.name.replace('/', '-')}-{self.id}"


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a run; one that is not there, or damaged, counts as empty, with an id of its own."""
    try:
        content = json.loads(content_of(folder / FILE, LARGEST_BYTES))
    except (OSError, ValueError, RecursionError):
        content = {}
    known: dict[str, Any] = content if isinstance(content, dict) else {}
    overrides, seed = known.get("overrides"), known.get("seed")
    return Manifest(
        _text(known, "id") or new_id(),
        folder.resolve(),
        _text(known, "experiment"),
        tuple(map(str, overrides)) if isinstance(overrides, list) else (),
        seed if type(seed) is int else None,
        _text(known, "identity"),
        _text(known, "began"),
        _text(known, "omnilab"),
        _text(known, "commit"),
    )


def recipe_of(experiment: str, overrides: Sequence[str]) -> str | None:
    """The recipe that a run's overrides are added to: one that chose a study alone is named by that. None without one."""
    names = {word.partition("=")[0] for word in overrides}
    if "~experiment" in names:
        return None
    return DEFAULT_RECIPE if "study" in names and "experiment" not in names else experiment


def new_id() -> str:
    """An id that no run has had."""
    return secrets.token_hex(6)


def _text(known: dict[str, Any], key: str) -> str:
    value = known.get(key)
    return value if isinstance(value, str) else ""
