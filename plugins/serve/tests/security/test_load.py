"""Many clients at once."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest

CLIENTS, ROUNDS = 200, 3


def run(work: Coroutine[None, None, list[Any]]) -> list[Any]:
    """Its result; in a thread, for the browser of other tests keeps a loop in this one."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, work).result()


@pytest.mark.slow
def test_two_hundred_clients_poll_at_once(serve, finished_runs):
    served = serve(logs=finished_runs)
    paths = ["/", "/api/runs", "/api/sweeps", "/api/submissions", "/parts/runs", "/api/session"]

    async def poll(client: httpx.AsyncClient, which: int) -> list[tuple[str, int]]:
        mine = [paths[(which + i) % len(paths)] for i in range(ROUNDS)]
        return [(path, (await client.get(path)).status_code) for path in mine]

    async def all_of_them() -> list[list[tuple[str, int]]]:
        limits = httpx.Limits(max_connections=CLIENTS)
        async with httpx.AsyncClient(base_url=served.url, limits=limits, timeout=200) as client:
            return await asyncio.gather(*(poll(client, which) for which in range(CLIENTS)))

    found = Counter(answer for answers in run(all_of_them()) for answer in answers)
    assert {status for _, status in found} == {200}
    assert sum(found.values()) == CLIENTS * ROUNDS


@pytest.mark.slow
def test_two_hundred_pages_watch_at_once_and_are_all_told(serve):
    served = serve()

    async def watch(client: httpx.AsyncClient) -> str:
        async with client.stream("GET", "/events") as stream:
            async for line in stream.aiter_lines():
                if line.startswith("data:"):
                    return line
        return ""

    async def all_of_them() -> list[str]:
        limits = httpx.Limits(max_connections=CLIENTS)
        async with httpx.AsyncClient(base_url=served.url, limits=limits, timeout=200) as client:
            watching = [asyncio.create_task(watch(client)) for _ in range(CLIENTS)]
            while served.app.state.service.events.count < CLIENTS:
                await asyncio.sleep(0.05)
            served.app.state.service.events.publish("run a")
            return await asyncio.gather(*watching)

    assert run(all_of_them()) == ["data: run a"] * CLIENTS
