"""Many small messages of numbers, such as points, put into another at once."""

from __future__ import annotations

import numpy as np
from google.protobuf.message import Message  # type: ignore[import-untyped]

from omnilab.api import Floats

NESTED, DOUBLE = 2, 1  # protobuf's wire types: a message with its length before it, eight bytes
DOUBLE_BYTES = 9  # of a field with its tag


def add_vectors(message: Message, field: str, values: Floats) -> None:
    """Append messages whose fields are doubles, one of each row of values (N, F), to a repeated field.

    They are made as protobuf writes them, all rows in one array, and read by protobuf: no object is made for each.
    """
    whole = message.DESCRIPTOR.fields_by_name[field]
    parts = sorted(part.number for part in whole.message_type.fields)
    layout = [("tag", "u1"), ("length", "u1")]
    layout += [pair for number in parts for pair in ((f"tag {number}", "u1"), (f"value {number}", "<f8"))]
    wire = np.empty(len(values), np.dtype(layout))
    wire["tag"], wire["length"] = whole.number << 3 | NESTED, DOUBLE_BYTES * len(parts)
    for number, column in zip(parts, np.asarray(values, float).T, strict=True):
        wire[f"tag {number}"], wire[f"value {number}"] = number << 3 | DOUBLE, column
    message.MergeFromString(wire.tobytes())
