"""The command line: our commands, those that plugins add, and for everything else Hydra's."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING

from omnilab.errors import ConfigError, OmnilabError, did_you_mean, of_machine
from omnilab.runner.discovery import discover_loudly
from omnilab.runner.interrupts import uninterrupted
from omnilab.runner.streams import unwritten
from omnilab.runner.terminal import print_error

if TYPE_CHECKING:
    from omnilab.hooks import Command
    from omnilab.runner.registry import Registry

COMMANDS = {  # the module of each, which is imported when it is given: numpy alone takes longer than all that is here
    "plugins": "omnilab.runner.plugins.command",
    "new": "omnilab.runner.authoring.new",
    "runs": "omnilab.runner.run_commands",
    "repeat": "omnilab.runner.run_commands",
    "repair": "omnilab.runner.run_commands",
    "sweep": "omnilab.runner.sweeps.commands",
    "compare": "omnilab.runner.compare.command",
    "fidelity": "omnilab.runner.fidelity.command",
    "submit": "omnilab.runner.remote.commands",
    "docs": "omnilab.runner.site.command",
    "check": "omnilab.runner.authoring.check",
}

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
        return _own_command(argv[0])(argv[1:])
    if argv == ["--version"]:
        from omnilab import __version__

        sys.stdout.write(f"omnilab {__version__}\n")
        return 0
    if argv and re.fullmatch(r"[a-z]+", argv[0]):
        return _plugins_command(argv[0])(argv[1:])
    with _importing():
        from omnilab.runner.hydra_app import experiment
        from omnilab.runner.overrides.completion import is_asked, next_words, recipes_alone
    with uninterrupted():
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
    from omnilab.api import KINDS

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


def _own_command(name: str) -> Command:
    with _importing():
        command: Command = getattr(import_module(COMMANDS[name]), name)
    return command


def _plugins_command(name: str) -> Command:
    registry = discover_loudly()
    commands = registry.commands
    if name not in commands:
        known = _command_names(registry)
        raise ConfigError(
            f"'{name}' is no command; there is {', '.join(known)}, and overrides such as experiment=grid"
            + did_you_mean(name, known)
            + registry.failed
        )
    from omnilab.hooks import CommandIn

    command = commands[name]
    with _importing():
        return command.load() if isinstance(command, CommandIn) else command


@contextmanager
def _importing() -> Iterator[None]:
    """Within it Ctrl-C ends the process when all is imported, and without a word: nothing has begun."""
    try:
        with uninterrupted():
            yield
    except KeyboardInterrupt:
        sys.exit(130)
