"""Connections on which nothing is asked are closed: each takes a place."""

from __future__ import annotations

import asyncio

from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

# In which a request must have come whole, but for its body; the next one too, on a connection that has had one. Clients forget an
# idle connection after 5 s, some later: closed as soon as that, it would be closed below a request that is on its way.
REQUEST_S = 20  # seconds


class TimedConnection(H11Protocol):
    """uvicorn's connection, which alone waits for the rest of a request for ever."""

    _answered: RequestResponseCycle | None = None  # the last request, as it was when it was looked at last
    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._timer = self.loop.call_later(REQUEST_S, self._check)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._timer:
            self._timer.cancel()
        super().connection_lost(exc)

    def _check(self) -> None:
        cycle: RequestResponseCycle | None = self.cycle  # uvicorn sets it to None at first
        is_waiting = cycle is None or cycle.response_complete
        if is_waiting and cycle is self._answered:
            self.transport.close()
            return
        self._answered = cycle if is_waiting else None
        self._timer = self.loop.call_later(REQUEST_S, self._check)
