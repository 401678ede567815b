"""The command `omnilab plugins`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from omnilab.errors import ConfigError, did_you_mean, visible
from omnilab.runner.discovery import discover
from omnilab.runner.plugins.listing import Listed, Listing, keep, kept
from omnilab.runner.terminal import print_error

if TYPE_CHECKING:
    from omnilab.runner.registry import Component, Registry


def plugins(argv: list[str]) -> int:
    """List every component, recipe and world there is, failures last; or show the manual of those that are named."""
    parser = argparse.ArgumentParser("omnilab plugins", description=plugins.__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="show the manual and the settings of this component")
    parser.add_argument(
        "--json", action="store_true", help="as data: of those that are named, or of all and of the run"
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="show the tracebacks of plugins that failed")
    options = parser.parse_args(argv)
    asks_for_all = not (options.names or options.json or options.verbose)
    if asks_for_all and (listing := kept()):
        _print_listing(listing)
        return 0
    began_s = time.time()
    registry = discover()
    if options.json:
        _print_data(options.names, registry)
        return 0
    if options.names:
        _print_manuals(options.names, registry)
        return 0
    listing = _listing(registry)
    _print_listing(listing)
    for failure in registry.failures:
        print_error(failure.sentence)
        if options.verbose:
            sys.stderr.write(failure.traceback)
    if not registry.failures and _all_ours(registry):
        keep(listing, _folders(registry), began_s)
    return 1 if registry.failures else 0


def _all_ours(registry: Registry) -> bool:
    """Whether every plugin is of omnilab[all]."""
    from omnilab.runner.plugins.finding import own_distributions

    return {plugin.distribution for plugin in registry.taken.values()} <= own_distributions()


def _folders(registry: Registry) -> set[Path]:
    """Where recipes and worlds lie."""
    return {*registry.folders, *(recipe.file.parent for recipe in registry.recipes.values())}


def _listing(registry: Registry) -> Listing:
    from omnilab.api import KINDS
    from omnilab.runner.plugins.folders import comment_of

    listing: Listing = []
    for kind in KINDS:
        rows = []
        for name in registry.names(kind):
            component = registry.get(kind, name)
            cls, plugin = component.cls, component.plugin
            origin = f"{cls.__module__}.{cls.__qualname__}, {plugin.distribution} {plugin.version}"
            rows.append(Listed(name, origin, component.summary))
        listing.append((kind, rows))
    for what, shipped in ("experiment", registry.recipes), ("world", registry.worlds):
        rows = []
        for name, found in sorted(shipped.items()):
            origin = f"{found.file}, {found.plugin.distribution} {found.plugin.version}"
            rows.append(Listed(name, origin, comment_of(found.file)[0]))
        listing.append((what, rows))
    return listing


def _print_listing(listing: Listing) -> None:
    from rich.console import Console, Group
    from rich.padding import Padding
    from rich.text import Text

    lines: list[Text | Padding] = []
    for kind, rows in listing:
        lines.append(Text(kind, "bold"))
        for row in rows:
            name, origin, summary = map(visible, row)
            parts = ("  ", (name, "cyan"), "  ", (origin, "dim"))
            lines.append(Text.assemble(*parts, no_wrap=True, overflow="ignore"))
            if summary:
                lines.append(Padding(Text(summary), (0, 0, 0, 6)))
    Console(highlight=False).print(Group(*lines), crop=False)


def _print_manuals(names: Sequence[str], registry: Registry) -> None:
    import inspect

    from rich.console import Console
    from rich.text import Text

    from omnilab.runner.manual import settings_of

    console = Console(highlight=False, soft_wrap=True)
    for component in _of_names(names, registry):
        title = f"{component.kind}={component.name}"
        console.print(Text.assemble((title, "bold"), "  ", (visible(component.plugin.title), "dim")))
        console.print(inspect.cleandoc(component.cls.__doc__ or "(no docstring)") + "\n", markup=False)
        for line in settings_of(component.cls):
            console.print(f"    {line}", markup=False)


def _print_data(names: Sequence[str], registry: Registry) -> None:
    """Components with their settings, as JSON; without names all there are, and before them the run's own settings."""
    import inspect

    from omnilab.runner.config import Settings
    from omnilab.runner.manual import settings_data
    from omnilab.runner.plugins.folders import comment_of

    chosen = _of_names(names, registry) if names else registry.components.values()
    found = [(c.kind, c.name, c.plugin.distribution, c.cls) for c in chosen]
    if not names:
        found.insert(0, ("run", "run", "omnilab", Settings))
    data = [
        {"kind": kind, "name": name, "distribution": distribution,
         "manual": inspect.cleandoc(cls.__doc__ or ""), "settings": settings_data(cls)}
        for kind, name, distribution, cls in found
    ]  # fmt: skip
    if not names:
        shipped = [("experiment", registry.recipes), ("world", registry.worlds)]
        data += [
            {"kind": what, "name": name, "distribution": found.plugin.distribution,
             "manual": " ".join(comment_of(found.file)), "settings": [], "file": str(found.file)}
            for what, each in shipped for name, found in each.items()
        ]  # fmt: skip
    sys.stdout.write(json.dumps(data, indent=1, allow_nan=False) + "\n")


def _of_names(names: Sequence[str], registry: Registry) -> Iterator[Component]:
    """The components that are called so, of any kind; ConfigError for a name that none has."""
    for name in names:
        found = [c for c in registry.components.values() if name in {c.name, c.formerly}]
        if not found and name in registry.recipes:
            raise ConfigError(
                f"'{name}' is an experiment, no component; its settings: omnilab experiment={name} --cfg job"
            )
        if not found and name in registry.worlds:
            raise ConfigError(f"'{name}' is a world, no component; a virtual camera is in it with sensor.world={name}")
        if not found:
            known = sorted({component.name for component in registry.components.values()})
            raise ConfigError(
                f"there is no component '{name}'; there is {', '.join(known)}"
                + did_you_mean(name, known)
                + registry.failed
            )
        yield from found
