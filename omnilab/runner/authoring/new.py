"""The command `new`: a component made of a template, as a distribution or as a single file."""

from __future__ import annotations

import argparse
import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from omnilab.api import KINDS
from omnilab.errors import ConfigError, DataError, did_you_mean
from omnilab.runner.authoring.names import check_name, check_recipe_name
from omnilab.runner.authoring.rendering import NewComponent, distribution, recipe, single_file
from omnilab.runner.discovery import discover_loudly

RECIPE = "recipe"  # what can be made beside components


def new(argv: list[str]) -> int:
    """Make a component of your own: a small one that works, to be changed, with its tests."""
    parser = argparse.ArgumentParser("omnilab new", description=new.__doc__)
    parser.add_argument("kind", metavar="KIND", help=f"{', '.join(KINDS)}; or {RECIPE}, of an experiment: one file")
    parser.add_argument("name", metavar="NAME", help="what it is called in commands: KIND=NAME")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--package", action="store_true", help="a distribution, to be installed and published (default)")
    form.add_argument(
        "--file", action="store_true", help="a single file, for OMNILAB_PLUGINS, with its tests beside it"
    )
    parser.add_argument(
        "--into", type=Path, default=Path(), metavar="DIR", help="the folder to make it in (default: .)"
    )
    options = parser.parse_args(argv)
    if options.kind == RECIPE:
        if options.package:
            raise ConfigError(
                f"a recipe is one file, so --package makes none; leave it out, or make a study, whose package holds a recipe:"
                f" {_omnilab()} new study {options.name}"
            )
        return _new_recipe(options.name, options.into)
    if options.kind not in KINDS:
        known = [*KINDS, RECIPE]
        raise ConfigError(
            f"'{options.kind}' is no kind of component; there is {', '.join(known)}{did_you_mean(options.kind, known)}"
        )
    component = NewComponent(options.kind, options.name)
    check_name(component, component.name if options.file else component.package, discover_loudly())
    if options.file:
        made = _move_files(single_file(component), options.into)
        _say(f"{made[0]} and {made[1]} are made", _steps_of_file(component, made[0].parent))
    else:
        folder = options.into / component.distribution
        _move_folder(distribution(component, _author(component)), folder)
        _say(f"{folder} is made", _steps_of_distribution(component, folder))
    return 0


def _new_recipe(name: str, into: Path) -> int:
    """A recipe, where `--config-dir` finds it."""
    check_recipe_name(name, discover_loudly())
    folder, text = into / "experiment", recipe(name)
    if into.is_dir():
        with _in_sentences(into):
            folder.mkdir(exist_ok=True)
    (made,) = _move_files({f"{name}.yaml": text}, folder)
    command = f"{_omnilab()} --config-dir {shlex.quote(str(into))} experiment={name}"
    _say(f"{made} is made", [(f"{command} --cfg job", "all that it sets"), (command, "a run of it")])
    return 0


# ------------------------------------------------------------------------------------------------------------- writing
def _move_folder(texts: Mapping[str, str], folder: Path) -> None:
    """Write texts by path into a new folder, all of them or none; DataError if there is something in it."""
    with _in_sentences(folder.parent):
        taken = folder.exists() and not (folder.is_dir() and not any(folder.iterdir()))
    if taken:
        raise DataError(f"{folder} is there already and not empty; move it away, or give another name or --into DIR")
    with _written(texts, folder.parent) as made:
        made.rename(folder)


def _move_files(texts: Mapping[str, str], into: Path) -> list[Path]:
    """Write texts by name into a folder, all of them or none; DataError if one of the names is taken."""
    targets = [into / name for name in texts]
    with _in_sentences(into):
        taken = next((target for target in targets if target.exists()), None)
    if taken:
        raise DataError(f"{taken} is there already; move it away, or give another name or --into DIR")
    with _written(texts, into) as made:
        moved: list[Path] = []
        try:
            for target in targets:
                (made / target.name).rename(target)
                moved.append(target)
        except OSError:
            for target in moved:
                target.unlink()
            raise
    return targets


@contextmanager
def _written(texts: Mapping[str, str], into: Path) -> Iterator[Path]:
    """A folder beside its place-to-be with texts by path, which is gone afterwards with what was not moved out of it."""
    if not into.is_dir():
        raise DataError(f"there is no folder {into}; make it first, or give another with --into DIR")
    with _in_sentences(into), tempfile.TemporaryDirectory(prefix=".omnilab-new-", dir=into) as temporary:
        made = Path(temporary) / "made"
        made.mkdir()
        for name, text in texts.items():
            (made / name).parent.mkdir(parents=True, exist_ok=True)
            (made / name).write_text(text, encoding="utf-8")
        yield made


@contextmanager
def _in_sentences(into: Path) -> Iterator[None]:
    """DataError for what a disk refuses."""
    try:
        yield
    except OSError as error:
        raise DataError(
            f"nothing can be made in {into} ({error.strerror}); mend that, or give another folder with --into DIR"
        ) from error


def _author(component: NewComponent) -> str:
    """The user's name as git knows it, if it does; git need not be there."""
    try:
        command = ["git", "config", "user.name"]
        name = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False).stdout.strip()
    except (OSError, subprocess.TimeoutExpired, UnicodeDecodeError):
        name = ""
    return name if name.isprintable() and name else f"The authors of {component.distribution}"


# ---------------------------------------------------------------------------------------------------------- next steps
def _say(what: str, steps: Sequence[tuple[str, str]]) -> None:
    """What was made, and commands with what each does."""
    width = max(len(command) for command, _ in steps)
    lines = [f"  {command:<{width}}  # {why}" if why else f"  {command}" for command, why in steps]
    sys.stdout.write("\n".join([f"{what}. Next:", *lines]) + "\n")


def _steps_of_distribution(component: NewComponent, folder: Path) -> list[tuple[str, str]]:
    editable = "-e ." if _has("pytest") else "-e '.[test]'"
    return [
        (f"cd {shlex.quote(str(folder))}", ""),
        (f"{_installer()} {editable}", f"now {component.kind}={component.name} is known, as the files are"),
        (f"{_python()} -m pytest", "its tests"),
        *_usage(component, _omnilab(), f"{component.kind}={component.name}"),
    ]


def _steps_of_file(component: NewComponent, folder: Path) -> list[tuple[str, str]]:
    place = [] if folder == Path() else [(f"cd {shlex.quote(str(folder))}", "")]
    tools = [] if _has("pytest") else [(f"{_installer()} pytest", "")]
    return [
        *place,
        *tools,
        (f"{_python()} -m pytest test_{component.name}.py", "its tests"),
        *_usage(component, f"OMNILAB_PLUGINS={component.name}.py {_omnilab()}", f"{component.name}.py"),
    ]


def _usage(component: NewComponent, omnilab: str, named: str) -> list[tuple[str, str]]:
    return [
        (f"{_omnilab()} check {named}", "every rule of its kind, and its time and memory"),
        (f"{omnilab} plugins {component.name}", "its manual and its settings"),
        (f"{omnilab} {component.run}", "a run with it; omnilab view shows it"),
    ]


def _has(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def _python() -> str:
    """How this Python is called from a shell; by its path where its name may mean another."""
    found = shutil.which("python")
    lasting = "UV_RUN_RECURSION_DEPTH" not in os.environ  # else the shell has it only while this command runs
    return "python" if lasting and found and Path(found).parent == Path(sys.executable).parent else _quoted_python()


def _quoted_python() -> str:
    return shlex.quote(sys.executable)


def _installer() -> str:
    """What installs packages for this Python: pip, or uv where that made the environment without it."""
    if not _has("pip") and shutil.which("uv"):
        return f"uv pip install --python {_quoted_python()}"
    pip = f"{_python()} -m pip install"
    return pip if _has("pip") else f"{_python()} -m ensurepip && {pip}"


def _omnilab() -> str:
    """How this command is called from a shell."""
    return "omnilab" if _python() == "python" else f"{_python()} -m omnilab"
