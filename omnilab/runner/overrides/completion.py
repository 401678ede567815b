"""What Hydra's shell completion does not know: our commands, and what they take."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout

from omnilab.runner.registry import Registry

QUERY = "query="  # omnilab -sc query=bash, by which a shell asks; what was typed is in the environment


def is_asked(argv: Sequence[str]) -> bool:
    """Whether a shell asks what may stand next."""
    return bool({"-sc", "--shell-completion"} & set(argv)) and any(word.startswith(QUERY) for word in argv)


def next_words(commands: Sequence[str], registry: Registry) -> tuple[list[str], bool]:
    """What may stand next in the line, beside what Hydra proposes; and whether Hydra is to be asked at all."""
    line = os.environ.get("COMP_LINE", "")
    typed = [*line.split()[1:], *([""] if line[-1:].isspace() else [])]
    if len(typed) < 2:
        return sorted({word for word in commands if word.startswith("".join(typed))}), True
    if typed[0] not in commands:
        return [], True
    names = {component.name for component in registry.components.values()}
    return sorted(names) if typed[0] in {"plugins", "check"} else [], False  # else a run, or a file: the shell's to say


@contextmanager
def recipes_alone() -> Iterator[None]:
    """What Hydra proposes meanwhile, less `claims=`: a folder beside the recipes in which no run looks."""
    with redirect_stdout(io.StringIO()) as proposed:
        yield
    words = proposed.getvalue().splitlines(keepends=True)
    sys.stdout.write("".join(word for word in words if not word.startswith("claims")))
