"""The command `omnilab serve`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from omnilab.errors import ConfigError
from omnilab_serve.settings import LOOPBACK, ServeSettings

PORT = 8700


def serve(argv: list[str]) -> int:
    """A web page for starting, watching, comparing and reviewing runs, on this machine."""
    parser = argparse.ArgumentParser("omnilab serve", description=serve.__doc__)
    parser.add_argument("--logs", type=Path, default=Path("logs"), help="the folder of the runs (default: logs)")
    parser.add_argument(
        "--host", default="127.0.0.1", help="the address to listen at (default: 127.0.0.1, this machine)"
    )
    parser.add_argument("--port", type=int, default=PORT, help=f"default: {PORT}")
    options = parser.parse_args(argv)
    if options.host not in LOOPBACK:
        raise ConfigError(f"--host {options.host} would let others in, who need a token")
    options.logs.mkdir(parents=True, exist_ok=True)
    settings = ServeSettings(logs=options.logs.absolute(), host=options.host, port=options.port)
    sys.stderr.write(f"omnilab is at http://{settings.host}:{settings.port} (Ctrl-C ends the page; runs go on)\n")
    listen(settings)
    return 0


def listen(settings: ServeSettings) -> None:
    """Serve until interrupted."""
    import uvicorn

    from omnilab_serve.app import create_app

    app = create_app(settings)
    app.state.service.queue.claim()
    uvicorn.run(app, host=settings.host, port=settings.port, log_level="warning", timeout_graceful_shutdown=2)
