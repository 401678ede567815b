"""The fingerprint of a component, for cache keys: settings, files, source code, versions, the processor."""

from __future__ import annotations

import ast
import hashlib
import platform
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from functools import cache
from importlib.metadata import packages_distributions, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from omnilab.runner.input_files import file_digests, leaves, names_folder

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
        lines += [f"{name} {version(name)}" for name in sorted(set(_distributions().get(top, [])))]
        if top in tops or not _is_installed(top):
            lines.append(f"source {top} {_digest(top)}")
            found = _imports(top) - seen - set(sys.stdlib_module_names)
            waiting += sorted(found)
            seen |= found
    return sorted(set(lines))


@cache
def _distributions() -> Mapping[str, list[str]]:
    return packages_distributions()


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
    """The top-level names of all absolute imports in a package's files, also those within functions."""
    return set().union(*(_imports_of(path.read_bytes()) for path in _files(top) if path.suffix == ".py"))


@cache
def _imports_of(content: bytes) -> frozenset[str]:
    """The same of one file; of none that is no module, as a template would be."""
    found: set[str] = set()
    with suppress(SyntaxError, ValueError):
        for node in _statements(ast.parse(content)):
            if isinstance(node, ast.Import):
                found |= {name.name.partition(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                found.add(str(node.module).partition(".")[0])
    return frozenset(found)


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """All within a module, a class, a function, a branch: imports are statements, and most of a program is expressions."""
    for part in ("body", "orelse", "finalbody", "handlers", "cases"):
        for statement in getattr(node, part, ()):
            yield statement
            yield from _statements(statement)


@cache
def _processor() -> str:
    """What decides which instructions numerical libraries choose."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines() if cpuinfo.exists() else []
    words = sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))})
    return f"{platform.machine()} {hashlib.sha256(' '.join(words).encode()).hexdigest()[:16]}"
