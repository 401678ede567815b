"""The options of commands that ask a server."""

from __future__ import annotations

import argparse


def add_server(parser: argparse.ArgumentParser) -> None:
    """The options that say which server."""
    parser.add_argument(
        "--server", metavar="URL", help="as omnilab serve prints it (default: OMNILAB_SERVER, or http://127.0.0.1:8700)"
    )
    parser.add_argument("--token", help="of the server (default: that of the URL, or OMNILAB_TOKEN)")
