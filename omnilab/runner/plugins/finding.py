"""Which plugins there are: installed distributions, and single files that OMNILAB_PLUGINS names."""

from __future__ import annotations

import os
import re
import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import Distribution, EntryPoint, PackageNotFoundError, distributions, entry_points, requires
from pathlib import Path
from types import ModuleType

import omnilab
from omnilab import __version__
from omnilab.errors import ConfigError, PluginError
from omnilab.runner.plugin_files import VARIABLE, file_of, load_file

DAMAGED = (ValueError, TypeError, KeyError, AttributeError, OSError)  # what reading the metadata of one raises


@dataclass(frozen=True)
class Plugin:
    """Where components come from."""

    name: str
    distribution: str
    version: str
    load: Callable[[], ModuleType] = field(compare=False)
    word: str = ""  # that names it in OMNILAB_PLUGINS, and no other

    @property
    def title(self) -> str:
        return f"plugin '{self.name}' ({self.distribution} {self.version})".replace(" )", ")")


ITSELF = Plugin("omnilab", "omnilab", __version__, lambda: omnilab)  # whose recipes are there without any plugin


def without(plugin: Plugin, chosen: Sequence[str]) -> str:
    """The variable as it is, but without one plugin."""
    named = plugin.word in chosen
    rest = [word for word in chosen if word != plugin.word] if named else [*chosen, f"-{plugin.word}"]
    return f"{VARIABLE}={shlex.quote(','.join(rest))}"


def plugins(chosen: Sequence[str]) -> Iterator[Plugin]:
    """Installed plugins, those of omnilab[all] first so that no other can take their names; then single files."""
    own, (points, found) = own_distributions(), _entry_points()
    count = Counter(point.name for point in points)
    for point in points:
        name, version = _named(point.dist)
        found.append(Plugin(point.name, name, version, point.load, point.name if count[point.name] == 1 else name))
    found.sort(key=lambda p: (p.distribution not in own, p.distribution, p.name))
    files = {os.path.realpath(file): (file, word) for word in chosen if (file := file_of(word))}  # each once
    found += [Plugin(file.stem, word, "", partial(load_file, file), word) for file, word in files.values()]
    known = {name for plugin in found for name in (plugin.name, plugin.distribution)}
    for word in chosen:
        if word != "none" and word.removeprefix("-") not in known and file_of(word) is None:
            raise ConfigError(
                f"{VARIABLE} names '{word}', which is no plugin; give file.py, none, or - and one of "
                + ", ".join(plugin.name for plugin in found)
            )
    left_out = {word.removeprefix("-") for word in chosen if word.startswith("-")}
    for plugin in found:
        names = {plugin.name, plugin.distribution}
        if not names & left_out and ("none" not in chosen or names & set(chosen)):
            yield plugin


def _entry_points() -> tuple[list[EntryPoint], list[Plugin]]:
    """Those of installed plugins; and as plugins that fail, the distributions that do not let themselves be read."""
    try:
        return list(entry_points(group="omnilab")), []
    except DAMAGED:  # one is damaged, and must not hide the others
        found: list[EntryPoint] = []
        failing: list[Plugin] = []
        seen: set[str] = set()
        for distribution in distributions():
            name, _ = _named(distribution)
            if name in seen:  # what is installed as its source is there twice
                continue
            seen |= {name} - {"?"}
            try:
                found += distribution.entry_points.select(group="omnilab")
            except DAMAGED as error:
                folder = Path(str(getattr(distribution, "_path", "?"))).name
                failing.append(Plugin(folder, name, "", partial(_fail, error), folder))
        return found, failing


def _fail(error: Exception) -> ModuleType:
    raise PluginError(f"what it says of itself cannot be read ({type(error).__name__}); install it anew") from error


def _named(distribution: Distribution | None) -> tuple[str, str]:
    """Name and version, "?" and "" where a distribution does not say."""
    if distribution is None:
        return "?", ""
    try:
        about = distribution.metadata  # which is read each time that it is asked for
        return about["Name"] or "?", about["Version"] or ""
    except DAMAGED:  # its metadata is no text
        return "?", ""


def missing_distributions() -> list[str]:
    """Those of omnilab[all] that are not installed."""
    here = {re.sub(r"[-_.]+", "-", _named(one)[0]).lower() for one in distributions()}
    return sorted(name for name in own_distributions() - {"omnilab"} if name not in here)


def own_distributions() -> set[str]:
    """The distributions of omnilab[all]."""
    try:
        wanted = requires("omnilab") or []
    except PackageNotFoundError:  # run from a source tree that was never installed
        return set()
    return {"omnilab"} | {re.split(r"[ ;<>=!~\[]", line)[0] for line in wanted if line.startswith("omnilab-")}
