"""The identity of a job: what its results depend on, as one digest."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

from omnilab.runner.config import Run, named_components
from omnilab.runner.input_files import file_digests, leaves
from omnilab.runner.registry import Registry
from omnilab.runner.run_folder.origin import commit
from omnilab.runner.shards.shard import ALL

CONTRACT = 1  # grows when the same components with the same settings may give other results
WITHOUT = {"limits", "cache_gb", "objective"}  # settings that no result depends on


def job_identity(run: Run, registry: Registry, files: Mapping[str, str] | None = None) -> str:
    """The SHA-256 over all that a run's results depend on, the same on every machine and in every folder.

    That is: kind, registered name, distribution and version of every component, all settings with seed and threads, and
    the digests of the files that settings name (`files`, of `file_digests`), which stand for the files' places. A shard's
    has the commit, too: what is merged was computed by one.
    """
    files = file_digests("", run) if files is None else files
    components = {
        slot: [named["name"], named["distribution"], named["version"]]
        for slot, named in named_components(run, registry).items()
    }
    settings = {path: _plain(value) for path, value in leaves("", run) if path not in WITHOUT and path not in files}
    if settings["device"] == Run.device:
        del settings["device"]  # as before there was any
    shard = str(settings.pop("shard", None) or ALL)
    content = {"contract": CONTRACT, "components": components, "settings": settings, "files": dict(files)}
    if not shard.startswith(ALL):  # what merges all is the whole run
        content |= {"shard": shard, "commit": commit()}
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """A setting as JSON has it."""
    if isinstance(value, Enum):
        return value.name
    return str(value) if isinstance(value, Path) else value
