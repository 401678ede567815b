"""What has changed, as server-sent events: an event a topic, without content."""

from __future__ import annotations

from collections.abc import AsyncIterator

from fastapi import APIRouter
from sse_starlette import EventSourceResponse, ServerSentEvent

from omnilab_serve.service import Here

router = APIRouter(include_in_schema=False)
PING_S = 15


@router.get("/events")
async def events(service: Here) -> EventSourceResponse:
    """The topics that change, until the client goes."""

    async def stream() -> AsyncIterator[ServerSentEvent]:
        async for topics in service.events.watch():
            for topic in sorted(topics):
                yield ServerSentEvent(data=topic, event="changed")

    return EventSourceResponse(stream(), ping=PING_S)
