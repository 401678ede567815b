"""What the tests of attacks share."""

from __future__ import annotations

import pytest
from fastapi.routing import APIRoute

from omnilab_serve.app import ROUTERS


@pytest.fixture(scope="session")
def routes() -> list[tuple[str, str]]:
    """Every method and path of the pages and the API, also of those that are added later."""
    paths = [route for router in ROUTERS for route in router.routes if isinstance(route, APIRoute)]
    found = [(method, route.path) for route in paths for method in sorted(route.methods)]
    assert {("GET", "/api/session"), ("GET", "/"), ("POST", "/login")} <= set(found)
    return found
