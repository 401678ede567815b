"""The OpenAPI document: every route of the API is in it, and its models are those of the client."""

from __future__ import annotations

import dataclasses
import inspect
import re

import pytest
from fastapi.routing import APIRoute

from omnilab.client import Client, models
from omnilab_serve import api

MODELS = dict(inspect.getmembers(models, dataclasses.is_dataclass))


@pytest.fixture
def document(serve):
    return serve().client.get("/api/openapi.json").json()


def test_every_route_of_the_api_is_in_it(document):
    expected = {
        (re.sub(r":path}", "}", route.path), method.lower())
        for router in api.ROUTERS
        for route in router.routes
        if isinstance(route, APIRoute)
        for method in route.methods
    }
    listed = {(path, method) for path, methods in document["paths"].items() for method in methods}
    assert listed == expected
    assert len(listed) > 15
    for methods in document["paths"].values():
        for name, operation in methods.items():
            assert operation.get("description") or operation.get("summary"), name


def test_its_models_are_those_of_the_client(document):
    """Every record that is answered or asked for is a dataclass that the client reads, field by field."""
    schemas = {
        name.removesuffix("-Output").removesuffix("-Input"): it
        for name, it in document["components"]["schemas"].items()
    }
    ours = {
        name: schema
        for name, schema in schemas.items()
        if not name.startswith(("HTTPValidation", "Validation", "Body_"))
    }
    assert {"RunRecord", "RunPage", "SweepRecord", "Submission", "SubmissionRequest", "Session"} <= set(ours)
    for name, schema in ours.items():
        assert set(schema["properties"]) == {field.name for field in dataclasses.fields(MODELS[name])}


def test_the_client_asks_for_every_route(document):
    """By the paths that stand in its source."""
    source = inspect.getsource(inspect.getmodule(Client))
    asked = {re.sub(r"{[^}]*}", "{}", path) for path in re.findall(r'"(/api/[^"?]*)"', source)}
    routes = {re.sub(r"{[^}]*}", "{}", path) for path in document["paths"]}
    assert asked == routes
