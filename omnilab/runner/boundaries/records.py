"""What studies log: curves whose numbers belong together, so that each sink need not find out."""

from __future__ import annotations

from typing import Any

from omnilab import api
from omnilab.runner.boundaries.values import Wrong, array, named, text


def unsound_record(record: Any) -> str:
    """What is wrong with a record; "" if nothing is, as far as is looked for here."""
    if not isinstance(record, api.Record):
        return f"{named(record)}; log an Image, a Series, a Pose or another of omnilab.api.records"
    try:
        if isinstance(record, api.Series):
            count = len(array(record.values, "`values`", (None,), "number", nan=True, inf=True))
            for name in "steps", "stamps_ns":
                array(getattr(record, name), f"`{name}`", (count,), "whole" if count else "number")
            text(record.unit, "`unit`")
    except Wrong as wrong:
        return f"{type(record).__name__} with {wrong}; see {type(record).__name__} in omnilab.api"
    return ""
