"""The command `omnilab docs`: builds the site from what is installed, and serves it to this machine alone."""

from __future__ import annotations

import argparse
import logging
import os
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from hashlib import sha256
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.metadata import requires
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from omnilab.errors import ConfigError, DataError
from omnilab.runner.discovery import discover
from omnilab.runner.registry import Registry

MARK = (
    ".omnilab-docs"  # in a folder that holds a site of ours, and no other files; MkDocs leaves what begins with a dot
)
LOOPBACK = "127.0.0.1"


def docs(argv: Sequence[str]) -> int:
    """Build the documentation, with a page for each method, recipe and setting that is installed, and serve it."""
    parser = argparse.ArgumentParser("omnilab docs", description=docs.__doc__)
    parser.add_argument("--build", type=Path, metavar="DIR", help="build it into DIR, and serve nothing")
    parser.add_argument("--port", type=int, default=8701, help=f"of http://{LOOPBACK} (default: %(default)s; 0: any)")
    options = parser.parse_args(argv)
    if not 0 <= options.port <= 65535:
        raise ConfigError(f"--port {options.port} is no port; give one from 0 to 65535")
    _check_installed()
    folder, registry = options.build or _cache(), discover()
    made_of = _digest(registry)
    if options.build or not _is_of(folder, made_of):
        build(folder, made_of)
    if options.build:
        sys.stdout.write(f"{folder / 'index.html'}\n")
        return 0
    _serve(folder, options.port)
    return 0


def build(folder: Path, made_of: str) -> None:
    """Build the site into a folder that is empty, or holds one already."""
    if folder.exists() and not (folder / MARK).is_file() and (not folder.is_dir() or any(folder.iterdir())):
        raise DataError(f"{folder} is there and holds no site of omnilab docs; give an empty or a new folder")
    from mkdocs.commands.build import build as mkdocs_build
    from mkdocs.config import load_config

    sys.stderr.write("omnilab: building the documentation, which takes half a minute\n")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARK).write_text("unfinished", encoding="utf-8")
    logging.getLogger("mkdocs").setLevel(logging.ERROR)  # pages of plugins that are not installed are missing
    with files("omnilab.runner.site").joinpath("site.yml").open("rb") as site:
        config = load_config(site, docs_dir=str(_sources()), site_dir=str(folder.resolve()), strict=False)
    mkdocs_build(config)
    (folder / MARK).write_text(made_of, encoding="utf-8")


def _sources() -> Path:
    return Path(str(files("omnilab.docs")))


def _check_installed() -> None:
    """ConfigError with the command that installs what is missing."""
    needed = [re.split(r"\s*;", line)[0] for line in requires("omnilab") or [] if re.search(r"extra == .docs.", line)]
    if missing := [name for name in ("mkdocs", "material", "mkdocstrings") if find_spec(name) is None]:
        command = f"uv pip install --python {sys.executable} " + " ".join(f"'{line}'" for line in needed)
        raise ConfigError(f"the site needs {', '.join(missing)}, not installed here; run: {command}")


def _cache() -> Path:
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (given if given.is_absolute() else Path.home() / ".cache") / "omnilab" / "docs"


def _is_of(folder: Path, made_of: str) -> bool:
    mark = folder / MARK
    return mark.is_file() and mark.read_text(encoding="utf-8") == made_of


def _digest(registry: Registry) -> str:
    """Of all that the site is made of: names, sizes and times of the files, and what is installed."""
    folders = {_sources(), Path(str(files("omnilab"))), Path(str(files("omnilab.conf")))}
    folders |= {Path(sys.modules[each.cls.__module__.partition(".")[0]].__file__ or "").parent
                for each in registry.components.values()}  # fmt: skip
    paths = sorted(
        path for folder in folders for path in folder.rglob("*") if path.suffix in {".py", ".md", ".yaml", ".yml"}
    )
    found = [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in paths]
    return sha256(repr([found, sorted(registry.components)]).encode()).hexdigest()


def _serve(folder: Path, port: int) -> None:
    try:
        server = ThreadingHTTPServer((LOOPBACK, port), partial(_Quiet, directory=str(folder)))
    except OSError as error:
        raise DataError(
            f"port {port} cannot be used ({error.strerror}); give another: omnilab docs --port 0"
        ) from error
    with server, suppress(KeyboardInterrupt):
        sys.stdout.write(f"the documentation: http://{LOOPBACK}:{server.server_port}/ (Ctrl-C ends it)\n")
        sys.stdout.flush()
        server.serve_forever()


class _Quiet(SimpleHTTPRequestHandler):
    """Says nothing of each file, and lists no folder."""

    def log_message(self, format: str, *args: object) -> None:
        """Nothing."""

    def list_directory(self, *_: object) -> None:
        """No page."""
        self.send_error(404)
