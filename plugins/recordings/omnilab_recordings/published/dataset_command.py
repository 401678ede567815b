"""Command `omnilab dataset`: published data sets, what a copy lacks, and its conversion. Nothing is downloaded."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from omnilab.errors import visible
from omnilab_recordings.published.conversions import form_of, prepare
from omnilab_recordings.published.published_set import PublishedSet, published_set, shipped_names


def dataset(argv: Sequence[str]) -> int:
    """Published data sets that you download yourself: list them, check a copy, prepare it as folders of images with positions."""
    options = _parser().parse_args(argv)
    if options.action == "list":
        for name in [options.name] if options.name else shipped_names():
            _print(described(published_set(name), full=options.name is not None))
        return 0
    published, folder = published_set(options.name), Path(options.folder)
    if options.action == "check":
        form, lacking = form_of(published, folder)
        found = "a whole copy" if not lacking else "not a whole copy"
        _print("\n".join([f"{folder}: {found} of {published.name}, as {form.about}", *(f"  {each}" for each in lacking),
                          f"  naming: {published.naming}"]))  # fmt: skip
        return 2 if lacking else 0
    _print("\n".join(prepare(published, folder, Path(options.output))))
    settings = " ".join(f"sensor.{key}={value}" for key, value in published.sensor.items())
    _print(f"use them with sensor=folder sensor.path=DIR {settings}".rstrip())
    return 0


def described(published: PublishedSet, full: bool) -> str:
    """A set in one line, or all that is known of it."""
    if not full:
        converted = "" if published.forms else ", no conversion"
        naming = "naming verified" if published.verified else "naming not verified"
        return f"{published.name:20s} {published.title} ({naming}{converted})"
    files = [
        f"  files ({form.about}): {', '.join(_expected(each.glob, each.count) for each in form.files)}"
        for form in published.forms
    ]
    settings = " ".join(f"sensor.{key}={value}" for key, value in published.sensor.items())
    lines = [
        f"{published.name}: {published.title}", f"  had at: {published.where}", f"  licence: {published.licence}",
        f"  cite: {published.cite}", f"  naming: {published.naming}", *files, *([f"  settings: {settings}"] if settings else []),
        *([f"  {published.notes}"] if published.notes else []),
    ]  # fmt: skip
    return "\n".join(lines)


def _expected(glob: str, count: int | None) -> str:
    return glob if count is None else f"{count} x {glob}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("omnilab dataset", description=dataset.__doc__)
    actions = parser.add_subparsers(dest="action", required=True, metavar="list|check|prepare")
    listed = actions.add_parser("list", help="the sets, or all that is known of one")
    listed.add_argument("name", nargs="?", metavar="NAME", help="of a set, or a .yaml of your own")
    for name, about in (
        ("check", "what a copy in DIR lacks"),
        ("prepare", "convert the copy in DIR into OUT, a new folder"),
    ):
        action = actions.add_parser(name, help=about)
        action.add_argument("name", metavar="NAME", help="of a set, or a .yaml of your own")
        action.add_argument("folder", metavar="DIR", help="where your copy is; nothing is written there")
    action.add_argument("output", metavar="OUT", help="a folder that is not there yet, or empty")
    return parser


def _print(text: str) -> None:
    from rich.console import Console

    Console(highlight=False, soft_wrap=True).print("\n".join(map(visible, text.splitlines())), markup=False)
