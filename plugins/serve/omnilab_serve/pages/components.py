"""What is installed: components, their manuals, plugins that failed."""

from __future__ import annotations

from fastapi import APIRouter

router = APIRouter(include_in_schema=False)
