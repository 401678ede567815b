"""What the service was started with."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

LOOPBACK = ("127.0.0.1", "::1", "localhost")
TOKEN_VARIABLE = "OMNILAB_TOKEN"  # of the environment
EVERY_ADDRESS = ("0.0.0.0", "::")


@dataclass(frozen=True)
class ServeSettings:
    """The command line of `omnilab serve`."""

    logs: Path  # absolute; the folder of the runs, which is all that is ever shown
    host: str = "127.0.0.1"  # the address that is listened at
    port: int = 8700
    token: str | None = None  # that every request needs; None: whoever is on this machine may come
    names: Sequence[str] = ()  # further names by which browsers may call it
    inputs: Sequence[Path] = field(default_factory=list)  # folders from which submitted runs may read files
    workers: int = 1  # submissions that run at once

    @property
    def hosts(self) -> list[str]:
        """The names that a request may have in its Host; at every address of the machine also any address."""
        own = [socket.gethostname(), socket.getfqdn()] if self.host in EVERY_ADDRESS else [self.host]
        return [name.lower() for name in (*LOOPBACK, *own, *self.names)]
