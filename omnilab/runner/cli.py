"""The command line: our commands, those that plugins add, and for everything else Hydra's."""

from __future__ import annotations

import argparse
import inspect
import json
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from omnilab import hooks
from omnilab.api import KINDS
from omnilab.errors import ConfigError, DataError, OmnilabError, did_you_mean, of_machine, visible
from omnilab.runner.discovery import discover, discover_loudly
from omnilab.runner.interrupts import uninterrupted
from omnilab.runner.manual import settings_data, settings_of
from omnilab.runner.plugins.folders import comment_of
from omnilab.runner.remote.options import add_server
from omnilab.runner.repair import mend, mend_copy
from omnilab.runner.run_folder import RUNNING, UNREADABLE, LoadedRun, find_runs, load_run, new_folder_name
from omnilab.runner.streams import unwritten
from omnilab.runner.terminal import headline, print_error, print_table, short, show_run

if TYPE_CHECKING:
    from omnilab.runner.registry import Component, Registry

LIMITS_OFF = "limits=off"

HELP = """\
omnilab: experiments in omnidirectional vision.

omnilab [-m] [experiment=NAME] [OVERRIDE ...]   run an experiment (-m: a sweep over comma-separated values)
omnilab {commands}   (each with --help)

{names}

A component's settings: omnilab plugins NAME. The whole configuration: omnilab experiment=NAME --cfg job
"""


def main(argv: Sequence[str] | None = None) -> None:
    """Run a command; a user's mistake is one line and exit code 2, a bug is a traceback."""
    argv = list(sys.argv[1:] if argv is None else argv)
    code: object
    try:
        code = _dispatch(argv)
    except (OmnilabError, OSError, MemoryError) as error:
        mistake = error if isinstance(error, OmnilabError) else of_machine(error)
        if mistake is None:
            raise
        print_error(str(mistake))
        code = 2
    except KeyboardInterrupt:
        print_error("interrupted; the logs are complete up to here")
        code = 130
    except SystemExit as ended:  # argparse
        code = ended.code
    if why := unwritten():
        print_error(f"standard output cannot be written ({why}); make room there, or give another place")
        code = code or 2
    sys.exit(code)


def _dispatch(argv: list[str]) -> int:
    if argv and argv[0] in COMMANDS:
        return _loaded(COMMANDS[argv[0]])(argv[1:])
    if argv == ["--version"]:
        from omnilab import __version__

        sys.stdout.write(f"omnilab {__version__}\n")
        return 0
    if argv and re.fullmatch(r"[a-z]+", argv[0]):
        return _loaded(_plugins_command(argv[0]))(argv[1:])
    with uninterrupted():
        from omnilab.runner.hydra_app import experiment
        from omnilab.runner.overrides.completion import is_asked, next_words, recipes_alone

        registry = discover_loudly()
    if "--help" in argv or "-h" in argv:
        return _help(registry)
    if is_asked(argv):
        words, more = next_words(_command_names(registry), registry)
        sys.stdout.write("".join(f"{word}\n" for word in words))
        with recipes_alone():
            return experiment(argv, registry) if more else 0
    return experiment(argv, registry)


def _help(registry: Registry) -> int:
    """What can be run. Hydra's own help copies all settings of all components for each kind, which takes seconds."""
    names = {"experiment": sorted(registry.recipes), "world": sorted(registry.worlds)}
    names |= {kind: registry.names(kind) for kind in KINDS}
    sys.stdout.write(
        HELP.format(
            commands=" | ".join(_command_names(registry)),
            names="\n".join(f"{kind}: {', '.join(names[kind])}" for kind in sorted(names)),
        )
    )
    return 0


def _command_names(registry: Registry) -> list[str]:
    """Our commands and those of plugins, each once: one of ours may hand on to one of a plugin."""
    return [*COMMANDS, *sorted(registry.commands.keys() - COMMANDS.keys())]


def _loaded(command: hooks.Command) -> hooks.Command:
    with uninterrupted():
        return command.load() if isinstance(command, hooks.CommandIn) else command


def _plugins_command(name: str) -> hooks.Command:
    registry = discover_loudly()
    commands = registry.commands
    if name not in commands:
        known = _command_names(registry)
        raise ConfigError(
            f"'{name}' is no command; there is {', '.join(known)}, and overrides such as experiment=grid"
            + did_you_mean(name, known)
            + registry.failed
        )
    return commands[name]


def plugins(argv: list[str]) -> int:
    """List every component, recipe and world there is, failures last; or show the manual of those that are named."""
    parser = argparse.ArgumentParser("omnilab plugins", description=plugins.__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="show the manual and the settings of this component")
    parser.add_argument(
        "--json", action="store_true", help="as data: of those that are named, or of all and of the run"
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="show the tracebacks of plugins that failed")
    options = parser.parse_args(argv)
    registry = discover()
    if options.json:
        _print_data(options.names, registry)
        return 0
    if options.names:
        _print_manuals(options.names, registry)
        return 0
    _print_plugins(registry)
    for failure in registry.failures:
        print_error(failure.sentence)
        if options.verbose:
            sys.stderr.write(failure.traceback)
    return 1 if registry.failures else 0


def _print_plugins(registry: Registry) -> None:
    from rich.console import Console, Group
    from rich.padding import Padding
    from rich.text import Text

    lines: list[Text | Padding] = []

    def add(name: str, origin: str, summary: str) -> None:
        parts = ("  ", (name, "cyan"), "  ", (visible(origin), "dim"))
        lines.append(Text.assemble(*parts, no_wrap=True, overflow="ignore"))
        if summary:
            lines.append(Padding(Text(summary), (0, 0, 0, 6)))

    for kind in KINDS:
        lines.append(Text(kind, "bold"))
        for name in registry.names(kind):
            component = registry.get(kind, name)
            cls, plugin = component.cls, component.plugin
            origin = f"{cls.__module__}.{cls.__qualname__}, {plugin.distribution} {plugin.version}"
            add(name, origin, component.summary)
    for what, shipped in ("experiment", registry.recipes), ("world", registry.worlds):
        lines.append(Text(what, "bold"))
        for name, found in sorted(shipped.items()):
            origin = f"{found.file}, {found.plugin.distribution} {found.plugin.version}"
            add(name, origin, visible(comment_of(found.file)[0]))
    Console(highlight=False).print(Group(*lines), crop=False)


def _print_manuals(names: Sequence[str], registry: Registry) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    for component in _of_names(names, registry):
        title = f"{component.kind}={component.name}"
        console.print(Text.assemble((title, "bold"), "  ", (visible(component.plugin.title), "dim")))
        console.print(inspect.cleandoc(component.cls.__doc__ or "(no docstring)") + "\n", markup=False)
        for line in settings_of(component.cls):
            console.print(f"    {line}", markup=False)


def _print_data(names: Sequence[str], registry: Registry) -> None:
    """Components with their settings, as JSON; without names all there are, and before them the run's own settings."""
    from omnilab.runner.config import Settings

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


def runs(argv: list[str]) -> int:
    """List the runs there are, with their status and main metrics."""
    parser = argparse.ArgumentParser("omnilab runs", description=runs.__doc__)
    parser.add_argument("logs", nargs="?", type=Path, help="where to look (default: logs)")
    add_server(parser)
    options = parser.parse_args(argv)
    if options.server and options.logs:
        raise ConfigError(
            f"give either a folder ({options.logs}) or a server ({options.server}); they have runs of their own"
        )
    if options.server:
        from omnilab.runner.remote.commands import run_rows  # and the network

        rows = run_rows(options.server, options.token)
    else:
        rows = _local_rows(options.logs or Path("logs"))
    print_table(["run", "status", "main metrics", "overrides"], rows)
    return 0


def _local_rows(logs: Path) -> list[list[str]]:
    found, rows = find_runs(logs)[::-1], []
    while found:
        rows.append(_described(found.pop(), logs))  # and what was read of it is let go
    return rows


def _described(run: LoadedRun, logs: Path) -> list[str]:
    """Name, status, main metrics, overrides; a damaged run must not hide the others."""
    name = str(run.folder).removeprefix(f"{logs}/")
    try:
        overrides = [override for override in run.manifest["overrides"] if override[:11] != "experiment="]
        return [name, _state(run), headline(run.metrics), " ".join(overrides)]
    except DataError as error:
        return [name, UNREADABLE, str(error), ""]


def _state(run: LoadedRun) -> str:
    """As "running 43 % (queries 86 of 200)"."""
    state = run.state
    progress = run.progress if state == RUNNING else None
    return f"{state} {progress.words}".rstrip() if progress else state


def repeat(argv: list[str]) -> int:
    """Run a run's configuration and seed again, and say whether the metrics are the same (exit code 1 if not)."""
    parser = _run_parser("omnilab repeat", repeat.__doc__)
    parser.add_argument("--logs", default="logs", metavar="DIR", help="where the new run goes (default: logs)")
    parser.add_argument(
        "--trust",
        action="store_true",
        help="open files and folders that the run names though they are not those it read",
    )
    parser.epilog = f"{LIMITS_OFF}, as for an experiment: try what the machine may be too small for"
    options = parser.parse_args([word for word in argv if word != LIMITS_OFF])
    first = load_run(options.run)
    name = _repeatable(first, options.run)
    second = _run_again(first, name, options.logs, options.trust, LIMITS_OFF not in argv)
    return _compare(first, second)


def _repeatable(run: LoadedRun, given: Path) -> str:
    """The experiment of a run that can be repeated; DataError for one that cannot."""
    if "components" not in run.manifest:
        raise DataError(f"{given} could not be built, so there is nothing to repeat: {run.status.get('error')}")
    if not run.metrics:
        raise DataError(f"{given} did not finish ({run.state}), so there is nothing to compare with; run it anew")
    name = str(run.manifest["experiment"])
    if not re.fullmatch(r"[\w-]+(/[\w-]+)*", name):
        raise DataError(f"{run.folder / 'manifest.json'} names the experiment '{name}', which is no name; correct it")
    return name


def _run_again(first: LoadedRun, name: str, logs: str, trust: bool, limits: bool) -> LoadedRun:
    """A new run of the same configuration; where it writes, and what it may take, is never as a file says."""
    from omnilab.runner.build import again
    from omnilab.runner.config import Settings, logs_folder
    from omnilab.runner.execute import execute

    registry = discover_loudly()
    cache = first.config.get("cache") and Settings.cache
    ours = {"logs": logs, "cache": cache, "cache_gb": Settings.cache_gb, "limits": limits}
    folder = Path(logs_folder(logs)) / name / new_folder_name()
    run = again(first.config | ours, first.manifest, registry, folder, None if trust else _digests(first))
    execute(run, folder, registry, first.manifest["overrides"], name, lambda report: show_run(report, folder))
    return load_run(folder)


def _compare(first: LoadedRun, second: LoadedRun) -> int:
    """Say whether the metrics are the same; the exit code."""
    different = [name for name in first.metrics if repr(first.metrics[name]) != repr(second.metrics.get(name))]
    if different:
        print_error(f"the metrics differ from {short(first.folder)}: {', '.join(different)}")
        return 1
    new = [name for name in second.metrics if name not in first.metrics]  # of a study that has grown since
    more = f"; {', '.join(new)} were not measured then" if new else ""
    print_error(f"the metrics are the same as in {short(first.folder)}, bit for bit{more}")
    return 0


def _digests(run: LoadedRun) -> dict[str, str]:
    """The digests of what a run read, by setting."""
    found = run.manifest.get("files")
    return found if isinstance(found, dict) else {}


def repair(argv: list[str]) -> int:
    """Mend the logs of a run that was killed."""
    parser = _run_parser("omnilab repair", repair.__doc__)
    parser.add_argument(
        "--ended",
        action="store_true",
        help="the run has ended, which cannot be told from here (it is listed as silent: it was on another host)",
    )
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="leave the run as it is, and mend a copy of it there"
    )
    options = parser.parse_args(argv)
    run = load_run(options.run)
    if options.output is None:
        done = mend(run, discover_loudly(), options.ended)
    else:
        done = [*mend_copy(run, options.output, discover_loudly()), f"the mended copy is {options.output}"]
    for sentence in done or [f"{short(run.folder)} is whole, nothing to repair"]:
        print_error(sentence)
    return 0


def _run_parser(command: str, description: str | None) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(command, description=description)
    parser.add_argument(
        "run", nargs="?", type=Path, default=Path("logs/latest"), help="run folder (default: the latest)"
    )
    return parser


COMMANDS: dict[str, hooks.Command] = {
    "plugins": plugins,
    "new": hooks.CommandIn("omnilab.runner.authoring.new", "new"),
    "runs": runs,
    "repeat": repeat,
    "repair": repair,
    "sweep": hooks.CommandIn("omnilab.runner.sweeps.commands", "sweep"),
    "compare": hooks.CommandIn("omnilab.runner.compare.command", "compare"),
    "fidelity": hooks.CommandIn("omnilab.runner.fidelity.command", "fidelity"),
    "submit": hooks.CommandIn("omnilab.runner.remote.commands", "submit"),
    "docs": hooks.CommandIn("omnilab.runner.site.command", "docs"),
    "check": hooks.CommandIn("omnilab.runner.authoring.check", "check"),
}
