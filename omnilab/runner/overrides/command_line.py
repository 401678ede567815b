"""The command line before Hydra reads it: options one by one, values quoted where Hydra would not take them as they are.

A setting that is a text (a path, a name, a regular expression) takes it as it was written, whatever is in it: Hydra's
grammar refuses accents and `=`, and reads `1e3` as a number. Lists, quoted texts, and in a sweep commas and functions
such as choice(), stay what they are.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, Quote, QuotedString
from hydra.errors import HydraException
from omegaconf import OmegaConf

from omnilab.api import KINDS
from omnilab.errors import ConfigError, did_you_mean
from omnilab.runner.config import Run, literal
from omnilab.runner.overrides.setting_types import is_list_of_texts, is_text, may_have_settings, types_of, wanted
from omnilab.runner.registry import Registry

OPTIONS = {  # what may follow each
    "--multirun": (), "--run": (), "--cfg": ("job", "hydra", "all"), "--resolve": (), "--package": "NAME",
    "--info": ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath"), "--config-dir": "DIR",
    "--config-name": "NAME", "--config-path": "DIR", "--hydra-help": (), "--shell-completion": (),
}  # fmt: skip
SHORT = {"--multirun": "-m", "--run": "-r", "--cfg": "-c", "--package": "-p", "--info": "-i", "--config-dir": "-cd",
         "--config-name": "-cn", "--config-path": "-cp", "--shell-completion": "-sc"}  # fmt: skip
MODES = ("--run", "--multirun", "--cfg", "--info", "--shell-completion")
FUNCTIONS = ("choice", "range", "interval", "glob", "sort", "shuffle", "tag", "int", "float", "str", "bool")
SETTINGS = {"hydra", *(field.name for field in fields(Run))}
FOLDERS = ("hydra.run.dir", "hydra.sweep.dir")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise _Refused(message)


class _Refused(Exception):
    """What argparse says of a command line."""


def for_hydra(argv: Sequence[str], registry: Registry) -> list[str]:
    """The command line as Hydra takes it; ConfigError, in one sentence, if it cannot."""
    for word in argv:
        if any("\ud800" <= c <= "\udfff" for c in word):
            raise ConfigError(f"{word} holds bytes that are no text in UTF-8; rename the file")
    options, words = _split(argv)
    multirun = "--multirun" in options or "hydra.mode=MULTIRUN" in words
    return [*options, *(_readable(word, multirun, registry) for word in words)]


# ------------------------------------------------------------------------------------------------------- options
def _split(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """The options, with what follows them, and the overrides."""
    parser = _Parser(add_help=False)
    for option, values in OPTIONS.items():
        names = [option, SHORT[option]] if option in SHORT else [option]
        if not values:
            parser.add_argument(*names, action="store_true")
        elif option == "--info":
            parser.add_argument(*names, nargs="?", const="all")
        else:
            parser.add_argument(*names)
    parser.add_argument("words", nargs="*")
    try:
        found = vars(parser.parse_intermixed_args(list(argv)))
    except _Refused as refused:
        raise ConfigError(_about_options(str(refused))) from None
    words: list[str] = found.pop("words")
    given = {f"--{name.replace('_', '-')}": value for name, value in found.items() if value not in (None, False)}
    _check_options(given, words)
    options = [word for name, value in given.items() for word in ([name] if value is True else [name, value])]
    return options, words


def _about_options(refused: str) -> str:
    if found := re.match(r"argument (--[\w-]+)\S*: ", refused):
        return f"{found[1]} {_takes(found[1])}"
    if found := re.match(r"unrecognized arguments: (\S+)", refused):
        return f"'{found[1]}' is no option; there is {', '.join(OPTIONS)}, --help{did_you_mean(found[1], OPTIONS)}"
    return f"the options cannot be read; there is {', '.join(OPTIONS)}, --help"


def _takes(option: str) -> str:
    values = OPTIONS[option]
    return (
        f"takes {' or '.join(values) if isinstance(values, tuple) else values} after it" if values else "stands alone"
    )


def _check_options(given: dict[str, Any], words: Sequence[str]) -> None:
    for option, value in given.items():
        if isinstance(choices := OPTIONS[option], tuple) and value is not True and value not in choices:
            raise ConfigError(f"{option} {value}: {option} takes {', '.join(choices)}{did_you_mean(value, choices)}")
    modes = [option for option in MODES if option in given]
    if len(modes) > 1:
        raise ConfigError(f"{' and '.join(modes)} do not go together; give one of them")
    if "--resolve" in given and "--cfg" not in given:
        raise ConfigError("--resolve says how --cfg prints; give --cfg job --resolve")
    if "--shell-completion" in given and not any(re.match(r"(install|uninstall|query)=", word) for word in words):
        raise ConfigError("--shell-completion takes install=bash, or uninstall=bash, after it")
    if (folder := given.get("--config-dir")) is not None and not Path(folder).is_dir():
        raise ConfigError(
            f"--config-dir {folder}: there is no such folder; give the one that holds experiment/NAME.yaml"
        )


# ------------------------------------------------------------------------------------------------------- overrides
def _readable(word: str, multirun: bool, registry: Registry) -> str:
    """One override, as Hydra takes it."""
    key, equals, value = word.partition("=")
    if not equals and not word.startswith("~"):
        raise ConfigError(_without_value(word, registry))
    _check_key(key, value, word, registry)
    if not equals:
        return word
    value = value.strip(" \t")
    if key in FOLDERS and value.strip("'\" ") == "":
        raise ConfigError(f"{key}={value} names no folder; give {key}=DIR")
    parsed = parse_override(word)
    types = types_of(key, registry)
    if is_text(types):
        return _text(key, value, parsed, multirun)
    kind = key.lstrip("+").partition("@")[0]
    if kind in {*KINDS, "experiment"} and parsed is not None and parsed.value() is None:
        raise ConfigError(f"{word} names nothing; what is chosen there is left out by ~{key.lstrip('+')}")
    if kind in KINDS and parsed is not None and isinstance(parsed.value(), (int, float, dict)):
        raise ConfigError(f"{word} is no name; give {key}={'|'.join(registry.names(kind))}")
    values = parsed.value() if kind in KINDS and parsed is not None else None
    if isinstance(values, list) and not all(_read(name) for name in values):
        raise ConfigError(f"{word} is no list of names; give {key}=[NAME,NAME] of {', '.join(registry.names(kind))}")
    if parsed is not None and _is_empty_range(parsed):
        raise ConfigError(f"{word} is a sweep over nothing; give a range whose end lies beyond its start")
    if parsed is not None:
        return word
    if is_list_of_texts(types) and value[:1] + value[-1:] == "[]" and not re.search(r"[][]", value[1:-1]):
        return f"{key}=[{','.join(quoted(_as_text(part)) for part in _parts(value[1:-1]))}]"
    if kind in KINDS:
        raise ConfigError(registry.missing(kind, value))
    if value[:1] in {"[", "{", "'", '"'} or re.match(rf"({'|'.join(FUNCTIONS)})\s*\(", value):
        raise ConfigError(f"{word} cannot be read{_what_is_wrong(value)}; {key} takes {wanted(types, key)}")
    if multirun and "," in value:
        return f"{key}={','.join(quoted(part) for part in _parts(value))}"
    return f"{key}={quoted(_home(value))}"


def _without_value(word: str, registry: Registry) -> str:
    if word in registry.recipes:
        return f"'{word}' is no setting; did you mean experiment={word}?"
    return f"'{word}' has no value; settings are given as NAME=VALUE, such as seed=1"


def _check_key(key: str, value: str, word: str, registry: Registry) -> None:
    """ConfigError if what stands before the = can be no setting's name."""
    name = key.lstrip("+~")
    if parse_override(f"{key}=0") is not None and name.strip("@"):
        _check_depth(name, registry)
        return
    tidy = key.strip()
    if tidy != key and parse_override(f"{tidy}=0") is not None:
        raise ConfigError(f"'{word}' has a space in its name; write {tidy}={value.strip()}")
    if (index := re.fullmatch(r"(.*)\[\d+\]", key)) and parse_override(f"{index[1]}=0") is not None:
        raise ConfigError(f"'{key}' is part of a list, which is set as a whole; give {index[1]}=[VALUE,VALUE]")
    raise ConfigError(f"'{key}' is no name of a setting; give NAME=VALUE, such as sensor.size=250 or seed=1")


def _check_depth(name: str, registry: Registry) -> None:
    """ConfigError for a setting of a setting that has none, such as sensor.size.x."""
    parts = name.split(".")
    for count in range(1, len(parts)):
        above = ".".join(parts[:count])
        types = types_of(above, registry)
        if types and not may_have_settings(types):
            raise ConfigError(
                f"'{name}' is not a setting: {above} has none of its own; it takes {wanted(types, above)}"
            )


def parse_override(word: str) -> Override | None:
    """The override as Hydra reads it; None if it does not."""
    try:
        return _parser().parse_override(word)
    except HydraException:
        return None


@cache
def _parser() -> OverridesParser:
    return OverridesParser.create()


def _is_empty_range(parsed: Override) -> bool:
    value: Any = parsed.value()
    return parsed.is_range_sweep() and not list(value.range())


def _what_is_wrong(value: str) -> str:
    for opening, closing in ("[]", "{}", "()"):
        if value.count(opening) != value.count(closing):
            return f": it has {value.count(opening)} '{opening}' and {value.count(closing)} '{closing}'"
    for quote in "'\"":
        if value.count(quote) % 2:
            return f": a {quote} is not closed"
    return ""


# ------------------------------------------------------------------------------------------------------- texts
def _text(key: str, value: str, parsed: Override | None, multirun: bool) -> str:
    """An override of a setting that is a text."""
    if parsed is not None and parsed.value() is None:
        return f"{key}={value}"
    if parsed is not None and parsed.is_sweep_override() and not _is_list(value, parsed):
        return f"{key}={value}"
    if _is_list(value, parsed) and not _exists(value):
        if not multirun:
            raise ConfigError(
                f"{key}={value} has a comma: for a sweep give -m, for one text with a comma in it quote it twice:"
                f" \"{key}='{value}'\""
            )
        texts = [_as_text(part) for part in _parts(value)]
        same = parsed is not None and [str(_read(element)) for element in parsed.value().list] == texts  # type: ignore[union-attr]
        return f"{key}={value if same else ','.join(map(quoted, texts))}"
    read = _read(parsed.value()) if parsed is not None else None
    plain = _plain(_home(value if read is None else read))
    return f"{key}={value if plain == read else quoted(plain)}"


def _read(value: Any) -> str | None:
    """A value that Hydra read as a text; None if it read a number, a list or the like."""
    return value.text if isinstance(value, QuotedString) else value if isinstance(value, str) else None


def _is_list(value: str, parsed: Override | None) -> bool:
    """Whether there are several values, with commas between them."""
    if parsed is not None:
        return parsed.is_sweep_override() and not re.match(rf"({'|'.join(FUNCTIONS)})\s*\(", value)
    return "," in value and value[:1] not in {"'", '"'}


def _parts(value: str) -> Iterator[str]:
    """What stands between commas that no quotes or brackets hold."""
    part, depth, quote = "", 0, ""
    for c in value:
        if quote:
            quote = "" if c == quote else quote
        elif c in "'\"" and not part.strip():
            quote = c
        elif c in "([{":
            depth += 1
        elif c in ")]}":
            depth -= 1
        if c == "," and not quote and depth <= 0:
            yield part.strip()
            part = ""
        else:
            part += c
    yield part.strip()


def _as_text(part: str) -> str:
    """One value of several, without its quotes."""
    quoted = part[:1] in {"'", '"'} and part[-1:] == part[:1] and len(part) > 1
    return _plain(_home(part[1:-1] if quoted else part))


def quoted(text: str) -> str:
    """A text as an override's value, whatever is in it."""
    return QuotedString(text, Quote.single).with_quotes()


def _home(text: str) -> str:
    """A path below the home folder, which no shell has expanded after sensor.path=."""
    return str(Path(text).expanduser()) if re.match(r"~(/|$)", text) else text


def _exists(text: str) -> bool:
    try:
        return Path(text).exists()
    except (OSError, ValueError):
        return False


def _plain(text: str) -> str:
    """The text with every ${ escaped that inserts neither a setting nor what a resolver finds."""

    def escaped(found: re.Match[str]) -> str:
        inserts = re.match(r"([\w.]+):|(\w+)[\w.\[\]]*\}", found[2])
        known = inserts and (OmegaConf.has_resolver(inserts[1]) if inserts[1] else inserts[2] in SETTINGS)
        return found[0] if known or len(found[1]) % 2 else str(literal(found[0]))

    return re.sub(r"(\\*)\$\{([^}]*\}?)", escaped, text)
