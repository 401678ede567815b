"""What has changed, as server-sent events: an event a topic, without content."""

from __future__ import annotations

from collections.abc import AsyncIterator

from fastapi import APIRouter, HTTPException
from sse_starlette import EventSourceResponse, ServerSentEvent

from omnilab_serve.service import Here

router = APIRouter(include_in_schema=False)
PING_S = 15
MOST_STREAMS = 256  # each holds a connection


@router.get("/events")
async def events(service: Here) -> EventSourceResponse:
    """The topics that change, until the client goes."""
    if service.events.count >= MOST_STREAMS:
        raise HTTPException(503, f"{MOST_STREAMS} pages watch already, which is all this service serves; close some")

    async def stream() -> AsyncIterator[ServerSentEvent]:
        async for topics in service.events.watch():
            for topic in sorted(topics):
                yield ServerSentEvent(data=topic, event="changed")

    return EventSourceResponse(stream(), ping=PING_S, shutdown_grace_period=1)
