"""Command `omnilab check`: whether components keep the contract, and what they cost beside the built-in ones."""

from __future__ import annotations

import argparse
import json
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnilab.api import KINDS
from omnilab.errors import ConfigError, visible, with_article
from omnilab.hooks import Command
from omnilab.runner.authoring.choosing import Chosen, add_file, chosen, named, of_file
from omnilab.runner.authoring.measuring import MeasuredCost, built_in_costs, cost_of, medians
from omnilab.runner.discovery import discover_loudly
from omnilab.runner.execute import pinned
from omnilab.runner.registry import Registry
from omnilab.testing.rules import FAILED, OK, UNCHECKED, Verdict, verdicts

SLOW = 10  # times the median of the built-in ones, from where it is words
TOO_SLOW = 50  # from where it is a failure, unless a built-in one of the kind is as slow
LARGE, LARGE_BYTES = 10, 50e6  # times the median, and at least so much, from where memory is words
DOUBTED = "doubted"
WORDS = {OK: "ok", FAILED: "FAILED", UNCHECKED: "cannot be checked", DOUBTED: "note"}
STYLES = {OK: "green", FAILED: "bold red", UNCHECKED: "dim", DOUBTED: "yellow"}
MANUAL = """\
Check components against the contract: every rule, with what is wrong and what fixes it, and time and memory beside the
built-in ones of the kind. The exit code is 0 where all is kept, 1 where something is broken, 2 where nothing could be checked.

  omnilab check descriptor=radon descriptor.angles=45   one component, with settings
  omnilab check radon                                   where no component of another kind is called so
  omnilab check my_plugin.py                            all that a file registers; with KIND=NAME one of them
  omnilab check distance=features descriptor=sift       a distance on signatures of a descriptor
  omnilab check odometry=recorded odometry.file=FILE sensor=folder sensor.path=DIR     on images of a sensor
  omnilab check study=grid study.query_count=5 sensor=mirror    a study with parts that you choose
  omnilab check DIR                                     not a component: the images of a folder (omnilab-recordings)
"""


@dataclass(frozen=True)
class Checked:
    """What came of a component."""

    component: str  # as KIND=NAME
    plugin: str
    verdicts: Sequence[Verdict]
    costs: Mapping[str, Any]

    @property
    def broken(self) -> int:
        return sum(verdict.state == FAILED for verdict in self.verdicts)


def check(argv: list[str]) -> int:
    """Check components; folders of images, and what else is no component, is the business of the plugin's command."""
    options, words = _parser().parse_known_args(argv)
    first = next(iter(words), "")
    if options.help and not words:
        sys.stdout.write(_parser().format_help() + "\n" + MANUAL)
        return 0
    is_file = first.endswith(".py") and Path(first).is_file()
    if is_file:
        add_file(Path(first))
    registry = discover_loudly()
    if not is_file and not _means_component(first, registry):
        return _folders(registry, first)(argv)
    found = []
    with pinned(1):
        for each in _chosen(words, is_file, registry):
            checked = _checked(each, registry, compare=not options.rules)
            found.append(checked)
            if not options.json:
                _show(checked, options.verbose)
    if options.json:
        sys.stdout.write(json.dumps({"components": [_data(each) for each in found]}, indent=1, allow_nan=False) + "\n")
    return int(any(each.broken for each in found))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "omnilab check", usage="omnilab check COMPONENT|FILE.py|DIR [SETTING=VALUE ...]", add_help=False,
        allow_abbrev=False,
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="as data")
    parser.add_argument("--rules", action="store_true", help="the rules alone: time and memory are not measured")
    parser.add_argument("-v", "--verbose", action="store_true", help="the tracebacks of what a component raises")
    parser.add_argument("-h", "--help", action="store_true", help="this; omnilab check DIR --help: of folders")
    return parser


def _means_component(word: str, registry: Registry) -> bool:
    """Whether a word means a component; ConfigError where it may as well mean a folder that is there."""
    is_there, names = Path(word).exists(), {c.name: c for c in registry.components.values()}
    if word in names and is_there:
        raise ConfigError(f"'{word}' is a component and a path here; give {names[word].kind}={word}, or ./{word}")
    if "=" in word and not is_there:
        return word.partition("=")[0].isidentifier()
    return bool(word) and not is_there and "/" not in word and not word.startswith(("-", "."))


def _folders(registry: Registry, word: str) -> Command:
    """The command of a plugin that checks folders of images."""
    if not word:
        raise ConfigError("nothing is named; give a component (KIND=NAME), a plugin's file or a folder of images")
    if "check" not in registry.commands:
        raise ConfigError(
            f"'{word}' is no component, and folders of images are checked by omnilab-recordings, which is not installed;"
            " pip install omnilab-recordings"
        )
    return registry.commands["check"]


def _chosen(words: Sequence[str], is_file: bool, registry: Registry) -> Iterator[Chosen]:
    """The components that are named, or that a file registers."""
    first, *rest = words
    if not is_file:
        yield chosen(named(first, registry), rest, registry)
        return
    own = of_file(Path(first), registry)
    if not rest:
        for component in own:
            yield chosen(component, [], registry)
        return
    component = named(rest[0], registry)
    if component not in own:
        there = ", ".join(f"{c.kind}={c.name}" for c in own)
        raise ConfigError(f"'{rest[0]}' is not of {first}, which has {there}; leave {first} out, or name one of these")
    yield chosen(component, rest[1:], registry)


def _checked(each: Chosen, registry: Registry, compare: bool) -> Checked:
    component = each.component
    found, costs = list(verdicts(each.trial)), dict[str, Any]()
    if compare:
        more, costs = _measured(each, registry)
        found += more
    return Checked(f"{component.kind}={component.name}", component.plugin.title, found, costs)


def _measured(each: Chosen, registry: Registry) -> tuple[list[Verdict], dict[str, Any]]:
    """Time and memory, beside the median of the built-in ones of the kind."""
    try:
        measured = cost_of(each.trial)
    except Exception:  # noqa: BLE001  a rule has words what it raises
        return [Verdict("time and memory", UNCHECKED, "it cannot be used, see above")], {}
    if measured is None:
        return [
            Verdict("time and memory", UNCHECKED, f"{with_article(each.component.kind)} has no usual amount of work")
        ], {}
    cost, unit = measured
    others = built_in_costs(each.component.kind, registry)
    if not others:
        return [Verdict("time and memory", UNCHECKED, "no built-in one is installed to compare with")], {}
    middle = medians(list(others.values()))
    of = f"the median of {len(others)} built-in {KINDS[each.component.kind].plural.replace('_', ' ')} per {unit}"
    slowest = max(each.seconds for each in others.values())
    data = {"unit": unit, "seconds": cost.seconds, "bytes": cost.bytes, "built_in": len(others),
            "median_seconds": middle.seconds, "median_bytes": middle.bytes}  # fmt: skip
    return [_time(cost, middle, slowest, of), _memory(cost, middle, of)], data


def _time(cost: MeasuredCost, middle: MeasuredCost, slowest: float, of: str) -> Verdict:
    times = cost.seconds / middle.seconds
    words = f"{_rounded(times)} times {'slower than ' if times >= SLOW else ''}{of} ({_ms(cost)} beside {_ms(middle)})"
    if times < SLOW:
        return Verdict("time", OK, words)
    advice = "; use array operations in place of loops over pixels, and prepare once what does not change"
    too_slow = times >= TOO_SLOW and cost.seconds > 1.5 * slowest
    return Verdict("time", FAILED if too_slow else DOUBTED, words + advice)


def _memory(cost: MeasuredCost, middle: MeasuredCost, of: str) -> Verdict:
    times = cost.bytes / max(middle.bytes, 1)
    words = f"{_rounded(times)} times {of} ({_rounded(cost.bytes / 1e6)} MB beside {_rounded(middle.bytes / 1e6)} MB)"
    if times < LARGE or cost.bytes < LARGE_BYTES:
        return Verdict("memory", OK, words)
    return Verdict("memory", DOUBTED, f"{words}; work on a few at a time")


def _rounded(value: float) -> str:
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _ms(cost: MeasuredCost) -> str:
    return f"{_rounded(1e3 * cost.seconds)} ms"


def _show(checked: Checked, verbose: bool) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    console.print(Text.assemble((checked.component, "bold"), "  ", (visible(checked.plugin), "dim")))
    for verdict in checked.verdicts:
        mark = Text(f"  {WORDS[verdict.state]:<18}", STYLES[verdict.state])
        console.print(mark + Text(verdict.rule + (f": {visible(verdict.why)}" if verdict.why else ""), ""))
        if verbose and verdict.error is not None:
            console.print("".join(traceback.format_exception(verdict.error)), markup=False)
    rules = [verdict for verdict in checked.verdicts if verdict.state in {OK, FAILED}]
    kept = f"breaks {checked.broken} of {len(rules)} rules" if checked.broken else f"keeps all {len(rules)} rules"
    console.print(f"{checked.component} {kept}", markup=False)


def _data(checked: Checked) -> dict[str, Any]:
    return {
        "component": checked.component,
        "plugin": checked.plugin,
        "kept": not checked.broken,
        "rules": [{"rule": v.rule, "state": v.state, "why": v.why} for v in checked.verdicts],
        "costs": dict(checked.costs),
    }
