"""The server of the page: one process, one socket, bounds on what others may take of it."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable

import uvicorn
from fastapi import FastAPI

from omnilab.errors import ConfigError
from omnilab_serve.security.connections import REQUEST_S, TimedConnection

MOST_CONNECTIONS = 600  # at once; each is an open file, of which a process has 1024 mostly
MOST_HEADERS = 32_000  # bytes, of all headers of a request
STOP_S = 1  # for answers that are being sent when the server ends


class PageServer(uvicorn.Server):
    """Serves an application at a socket; its service works as long."""

    def __init__(self, app: FastAPI, listener: socket.socket, ready: Callable[[], None] = lambda: None) -> None:
        config = uvicorn.Config(
            app, http=TimedConnection, ws="none", lifespan="off", log_level="warning", access_log=False,
            proxy_headers=False, server_header=False, limit_concurrency=MOST_CONNECTIONS, timeout_keep_alive=REQUEST_S,
            timeout_graceful_shutdown=STOP_S, h11_max_incomplete_event_size=MOST_HEADERS,
        )  # fmt: skip
        super().__init__(config)
        self._service, self._listener, self._ready = app.state.service, listener, ready

    def run(self, sockets: list[socket.socket] | None = None) -> None:
        """Start the service, serve until a signal, and stop it; what the service cannot do is raised before."""
        self._service.start()
        try:
            super().run([self._listener, *(sockets or [])])
        finally:
            self._service.stop()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._service.events.close()
        await super().shutdown(sockets)


def listener(host: str, port: int) -> socket.socket:
    """A socket at an address of this machine; port 0 is a free one."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        return socket.create_server(address[:2], family=family, backlog=1024)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            why = f"port {port} is taken, perhaps by another omnilab serve; give another, or --port 0 for a free one"
        elif error.errno == errno.EACCES:
            why = f"port {port} is not for users of this machine; give --port from 1024 to 65535"
        else:
            why = f"'{host}' is no address of this machine ({error.strerror}); give --host 127.0.0.1, or one of its own"
        raise ConfigError(why) from error
