"""The fingerprint of a component, for cache keys: settings, files, source code, versions, the processor."""

from __future__ import annotations

import hashlib
import platform
import re
import sys
import sysconfig
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from importlib.metadata import Distribution, distributions, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from omnilab.runner.input_files import file_digests, leaves, names_folder

IMPORTS = re.compile(r"(?:^|[;:])[ \t\f]*(?:from[ \t]+(\w+)[\w. \t]*import\b|import[ \t]+([^\n;#]+))", re.MULTILINE)
FIRST_NAMES = re.compile(r"(?:^|,)\s*(\w+)")  # of a list of dotted names
RECORDED = re.compile(r'^"?([^/,"\n]+)(?:/.*)?\.py"?,', re.MULTILINE)  # the top-level name of a distribution's file
INSTALLED = {Path(sysconfig.get_path(name)).resolve() for name in ("purelib", "platlib")}


def fingerprint(component: Any) -> str | None:
    """All that decides a component's results, one line each; None where that is not known.

    Its class, its settings and the content of the files they name; the files of the package that it comes from; of what
    that package imports, in turn: the files of source trees, the versions of installed distributions; Python and the
    processor. It is not known for a setting that names a folder, nor for a class without a source file.
    """
    cls = type(component)
    if any(names_folder(value) for _, value in leaves("", component)):
        return None
    tops = {base.__module__.partition(".")[0] for base in cls.__mro__} - set(sys.stdlib_module_names)
    if any(_files(top) == [] for top in tops):
        return None
    lines = [f"class {cls.__module__}.{cls.__qualname__}", f"settings {asdict(component)}"]
    lines += [f"file {path} {digest}" for path, digest in file_digests("", component).items()]
    lines += [*_source(frozenset(tops)), f"python {platform.python_version()}", f"processor {_processor()}"]
    return "\n".join(lines)


# ------------------------------------------------------------------------------------------------------ source code
@cache
def _source(tops: frozenset[str]) -> list[str]:
    """The content of top-level packages and what they import. Read once: a process runs what it imported."""
    lines, waiting, seen = [], sorted(tops), set(tops)
    while waiting:
        top = waiting.pop()
        lines += [f"{found.name} {version(found.name)}" for found in _distributions().get(top, [])]
        if top in tops or not _is_installed(top):
            lines.append(f"source {top} {_digest(top)}")
            found = _imports(top) - seen - set(sys.stdlib_module_names)
            waiting += sorted(found)
            seen |= found
    return sorted(set(lines))


@cache
def _distributions() -> Mapping[str, list[Distribution]]:
    """Those that a top-level name comes from; `packages_distributions` takes ten times as long over the same lists."""
    found = defaultdict(list)
    for distribution in distributions():
        declared = (distribution.read_text("top_level.txt") or "").split()
        for top in declared or set(RECORDED.findall(distribution.read_text("RECORD") or "")):
            found[top].append(distribution)
    return found


def _is_installed(top: str) -> bool:
    """Whether its version says all: it is not there, or part of an installed distribution rather than a source tree."""
    roots = _roots(top)
    return not roots or (top in _distributions() and not INSTALLED.isdisjoint(roots[0].resolve().parents))


def _digest(top: str) -> str:
    """Of the paths within a package, and the content, of its files: two folders may hold files of one name."""
    found = hashlib.sha256()
    for root in _roots(top):
        for path in _files_below(root):
            content, name = path.read_bytes(), path.relative_to(root.parent).as_posix()
            found.update(f"{name} {len(content)} ".encode() + content)
    return found.hexdigest()


def _files(top: str) -> list[Path]:
    """Those of a top-level module or package, whatever their type."""
    return [path for root in _roots(top) for path in _files_below(root)]


def _files_below(root: Path) -> list[Path]:
    """A module's one file, or all below a package's folder."""
    found = [root] if root.is_file() else sorted(root.rglob("*"))
    return [path for path in found if path.is_file() and "__pycache__" not in path.parts]


def _roots(top: str) -> list[Path]:
    """A module's file or a package's folders; none if it is not there or has no source."""
    module = sys.modules.get(top)
    spec = module.__spec__ if module else find_spec(top)
    if spec is None:
        return []
    if spec.submodule_search_locations is None:
        return [Path(spec.origin)] if spec.has_location and spec.origin else []
    return [Path(folder) for folder in spec.submodule_search_locations]


def _imports(top: str) -> set[str]:
    """The top-level names of all absolute imports in a package's files, also those within functions.

    Words of a text that reads like an import are among them, and cost nothing: parsing takes a second for our own files.
    """
    found: set[str] = set()
    for path in _files(top):
        if path.suffix == ".py":
            text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\\\n", " ")
            for origin, names in IMPORTS.findall(text):
                found.update(FIRST_NAMES.findall(origin or names))
    return found


@cache
def _processor() -> str:
    """What decides which instructions numerical libraries choose."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines() if cpuinfo.exists() else []
    words = sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))})
    return f"{platform.machine()} {hashlib.sha256(' '.join(words).encode()).hexdigest()[:16]}"
