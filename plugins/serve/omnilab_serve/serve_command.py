"""The command `omnilab serve`."""

from __future__ import annotations

import argparse
import os
import secrets
import socket
import sys
from pathlib import Path

from omnilab.errors import ConfigError
from omnilab_serve.settings import EVERY_ADDRESS, LOOPBACK, TOKEN_VARIABLE, ServeSettings

PORT = 8700
SHORTEST_TOKEN = 16


def serve(argv: list[str]) -> int:
    """A web page for starting, watching, comparing and reviewing runs; of this machine alone, unless --host is given."""
    options = _parser().parse_args(argv)
    if not 0 <= options.port <= 65535:
        raise ConfigError(f"--port {options.port} is no port; give one from 1 to 65535, or 0 for a free one")
    if options.workers < 1:
        raise ConfigError(f"--workers {options.workers} would run nothing; give 1 or more")
    for folder in options.inputs or []:
        if not folder.is_dir():
            raise ConfigError(f"--inputs {folder} is no folder; give one from which submitted runs may read files")
    token = _token(options.token or os.environ.get(TOKEN_VARIABLE), options.host)
    options.logs.mkdir(parents=True, exist_ok=True)

    from omnilab_serve.server import listener

    with listener(options.host, options.port) as opened:
        settings = ServeSettings(
            logs=options.logs.absolute(),
            host=options.host,
            port=opened.getsockname()[1],
            token=token,
            names=options.name,
            inputs=[folder.absolute() for folder in options.inputs or [Path()]],
            workers=options.workers,
        )
        listen(settings, opened, options.open)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("omnilab serve", description=serve.__doc__)
    parser.add_argument("--logs", type=Path, default=Path("logs"), help="the folder of the runs (default: logs)")
    parser.add_argument(
        "--host", default="127.0.0.1", help="the address to listen at; any but this machine's own needs a token"
    )
    parser.add_argument("--port", type=int, default=PORT, help=f"0: a free one (default: {PORT})")
    parser.add_argument(
        "--token", help=f"that everyone needs who comes (default: {TOKEN_VARIABLE}; with --host one is made)"
    )
    parser.add_argument(
        "--name", action="append", default=[], help="a further name by which browsers call it (repeatable)"
    )
    parser.add_argument(
        "--inputs", type=Path, action="append", metavar="DIR",
        help="a folder from which submitted runs may read files (repeatable; default: this one)",
    )  # fmt: skip
    parser.add_argument("--workers", type=int, default=1, help="how many submissions run at once (default: 1)")
    parser.add_argument("--open", action="store_true", help="open it in the browser")
    return parser


def _token(given: str | None, host: str) -> str | None:
    """The token that is needed: that which was given; one that is made where others can come; else none."""
    if given is None:
        return None if host in LOOPBACK else secrets.token_urlsafe(24)
    if len(given) < SHORTEST_TOKEN or not given.isascii() or not given.isprintable() or " " in given:
        raise ConfigError(
            f"the token has {len(given)} characters; give {SHORTEST_TOKEN} or more, of ASCII and without spaces"
        )
    return given


def listen(settings: ServeSettings, opened: socket.socket, in_browser: bool = False) -> None:
    """Serve at a socket until interrupted."""
    from omnilab_serve.app import create_app
    from omnilab_serve.server import PageServer

    def ready() -> None:
        sys.stderr.write(f"the page is at {address(settings)} (Ctrl-C ends the page; runs go on)\n")
        if in_browser:
            import webbrowser

            webbrowser.open(address(settings))

    app = create_app(settings)
    try:
        PageServer(app, opened, ready).run()
    except KeyboardInterrupt:
        sys.stderr.write("omnilab: the page has ended; runs that it started go on\n")


def address(settings: ServeSettings) -> str:
    """What a browser is given to come in."""
    host = socket.gethostname() if settings.host in EVERY_ADDRESS else settings.host
    url = f"http://{f'[{host}]' if ':' in host else host}:{settings.port}/"
    return f"{url}login?token={settings.token}" if settings.token else url
