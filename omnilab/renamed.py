"""Names of the version before: they go on working for this version, with one line that says the new one.

A plugin or a script that was written with the old names runs; what it says on the way is what to write instead. The
whole module, and what calls it, goes with the next version.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import partial, wraps
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

MODULES: dict[str, tuple[str, ...]] = {  # where the content of a module is now
    "omnilab.cache": ("omnilab.runner.cache",),
    "omnilab.calibration": ("omnilab.cameras.files",),
    "omnilab.cli": ("omnilab.runner.cli", "omnilab.runner.run_commands", "omnilab.runner.plugins.command"),
    "omnilab.console": ("omnilab.runner.console_sink",),
    "omnilab.distortion": ("omnilab.cameras.distortion",),
    "omnilab.experiment": ("omnilab.runner.hydra_app",),
    "omnilab.fingerprint": ("omnilab.runner.fingerprint",),
    "omnilab.graph_files": ("omnilab.posegraph.files",),
    "omnilab.graphs": ("omnilab.posegraph.graph",),
    "omnilab.interrupts": ("omnilab.runner.interrupts",),
    "omnilab.lenses": ("omnilab.cameras.lenses",),
    "omnilab.logbook": ("omnilab.runner.run_folder",),
    "omnilab.maps": ("omnilab.runner.map_file",),
    "omnilab.mirrors": ("omnilab.cameras.mirrors",),
    "omnilab.noncentral": ("omnilab.cameras.noncentral",),
    "omnilab.ocam": ("omnilab.cameras.ocam",),
    "omnilab.projection": ("omnilab.image", "omnilab.cameras"),
    "omnilab.record": ("omnilab.runner.recorder",),
    "omnilab.registry": ("omnilab.runner.registry",),
    "omnilab.resample": ("omnilab.cameras.reproject",),
    "omnilab.run": ("omnilab.runner.config", "omnilab.runner.build", "omnilab.runner.execute"),
    "omnilab.shelf": ("omnilab.runner.cache.row_store",),
    "omnilab.stereo": ("omnilab.cameras.stereo",),
    "omnilab.terminal": ("omnilab.runner.terminal",),
    "omnilab.trajectories": ("omnilab.trajectory.evaluation", "omnilab.trajectory.files"),
    "omnilab.trajectory_files": ("omnilab.trajectory.files",),
}
API = {
    "Arrangement": "Embedding",
    "Growing": "IncrementalGraph",
    "Layout": "PoseRequest",
    "Learner": "Trainable",
    "Learnt": "TrainedDescriptor",
    "MapMaker": "Embedder",
    "Memory": "PlaceDatabase",
    "OnlineBackend": "IncrementalBackend",
    "Tracker": "SequenceLocalizer",
}
TESTING = {"check_map_maker": "check_embedder"}
MEMBERS = {  # what components must offer
    "arrange": "embed",
    "follow": "track",
    "look": "extract",
    "motion": "estimate",
    "recall": "query",
    "turned": "rotation",
}
ROTATIONS = {"shifts": "equivariant", "same": "invariant", "changes": "none"}  # `rotation` for what `turned` said


def attribute(module: str, name: str, table: dict[str, str]) -> Any:
    """What a module's attribute of an old name is, for its `__getattr__`; AttributeError if there was none."""
    if name not in table:
        raise AttributeError(f"module '{module}' has no attribute {name!r}")
    warnings.warn(f"{module}.{name} is called {table[name]} now", FutureWarning, stacklevel=3)
    return getattr(import_module(module), table[name])


def accept(cls: type[Any], fields: dict[str, str]) -> None:
    """Let a dataclass be made, and read, with old names of its fields."""
    init = cls.__init__

    @wraps(init)
    def with_old_names(self: Any, *values: Any, **named: Any) -> None:
        for old in fields.keys() & named.keys():
            _say_renamed(cls, old, fields[old])
            named[fields[old]] = named.pop(old)
        init(self, *values, **named)

    cls.__init__ = with_old_names
    for old, new in fields.items():
        setattr(cls, old, property(partial(_read, old=old, new=new)))


def _read(instance: Any, old: str, new: str) -> Any:
    _say_renamed(type(instance), old, new)
    return getattr(instance, new)


def _say_renamed(cls: type[Any], old: str, new: str) -> None:
    warnings.warn(f"`{old}` of omnilab.api.{cls.__name__} is called `{new}` now", FutureWarning, stacklevel=3)


def adapt(kind: str, name: str, cls: type[Any]) -> str:
    """Let a descriptor that declares `turned` declare `rotation`: what to write instead, "" where all is well."""
    turned = getattr(cls, "turned", None)
    if kind != "descriptor" or hasattr(cls, "rotation") or turned not in ROTATIONS:
        return ""
    cls.rotation = ROTATIONS[turned]
    return f"descriptor '{name}' declares turned={turned!r}, which is called rotation={ROTATIONS[turned]!r} now"


def hint(cls: type[Any], lacking: Sequence[str]) -> str:
    """For a class that lacks members: which of its own are these by their old names."""
    found = [f"`{old}` is called `{new}` now" for old, new in MEMBERS.items() if new in lacking and hasattr(cls, old)]
    if "rotation" in lacking:
        found.append(f"rotation is one of {', '.join(ROTATIONS.values())}")
    return f" ({'; '.join(found)})" if found else ""


class Finder:
    """Imports a module by its old name: one that takes its attributes from where they are now.

    A finder and loader by its methods alone: `importlib.abc` takes as long to import as all of the contract's types.
    """

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:  # noqa: ARG002
        return ModuleSpec(fullname, self) if fullname in MODULES else None  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:  # noqa: ARG002
        return None

    def exec_module(self, module: ModuleType) -> None:
        homes = MODULES[module.__name__]
        warnings.warn(f"{module.__name__} is now {' and '.join(homes)}", FutureWarning, stacklevel=2)

        def lookup(name: str) -> Any:
            for home in homes:
                if hasattr(found := import_module(home), name):
                    return getattr(found, name)
            raise AttributeError(f"module '{module.__name__}' has no attribute {name!r}")

        module.__dict__["__getattr__"] = lookup
