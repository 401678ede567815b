"""Recipes, components and what the builder says of overrides, as data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fastapi import APIRouter

from omnilab.client import CheckedRequest, ComponentRecord, PluginFailure, RecipeRecord, SubmissionRequest
from omnilab_serve.composing import check_request
from omnilab_serve.pages.components import installed
from omnilab_serve.service import Here

router = APIRouter(prefix="/api", tags=["components"])


@router.get("/recipes")
def recipes(service: Here) -> Sequence[RecipeRecord]:
    """The experiments that are shipped."""
    return [RecipeRecord(**each) for each in service.composer.catalog()["recipes"]]


@router.get("/recipes/{name}")
def recipe(service: Here, name: str) -> dict[str, Any]:
    """A recipe's slots, what fills them, and every setting with its value."""
    found: dict[str, Any] = service.composer.form(name)
    return found


@router.get("/components")
def components(service: Here) -> Sequence[ComponentRecord]:
    """Every component that is installed."""
    return [ComponentRecord(**each) for each in service.composer.catalog()["components"]]


@router.get("/components/{kind}/{name}")
def component(service: Here, kind: str, name: str) -> ComponentRecord:
    """One component, with its manual and settings."""
    return installed(service, kind, name)


@router.get("/failed-plugins")
def failed_plugins(service: Here) -> Sequence[PluginFailure]:
    """The plugins that could not be loaded, and why."""
    return [PluginFailure(**each) for each in service.composer.catalog()["failures"]]


@router.get("/run-settings")
def run_settings(service: Here) -> Sequence[dict[str, Any]]:
    """A run's own settings, beside those of its components."""
    found: Sequence[dict[str, Any]] = service.composer.catalog()["run"]
    return found


@router.post("/check", responses={422: {"description": "The builder's sentence, and the setting that it is about"}})
def check(service: Here, request: SubmissionRequest) -> CheckedRequest:
    """What a request comes to, without running it."""
    return check_request(request, service.composer)
