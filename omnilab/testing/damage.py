"""Damages of logs, for tests of what sinks repair."""

from __future__ import annotations

import random

KINDS = ["flipped", "zeroed", "overwritten", "removed", "inserted", "zeroed tail", "cut", "lengthened"]


def damaged(data: bytes, kind: str, rng: random.Random) -> tuple[bytes, tuple[int, int]]:
    """The log with a damage of one of `KINDS`, and the stretch (start, end) of `data` that is not what it was."""
    size = len(data)
    start = rng.randrange(size)
    end = min(size, start + rng.choice([1, 9, 512, 4096]))
    match kind:
        case "flipped":
            return data[:start] + bytes([data[start] ^ 1 << rng.randrange(8)]) + data[start + 1 :], (start, start + 1)
        case "zeroed":
            return data[:start] + bytes(end - start) + data[end:], (start, end)
        case "overwritten":
            return data[:start] + rng.randbytes(end - start) + data[end:], (start, end)
        case "removed":
            return data[:start] + data[end:], (start, end)
        case "inserted":
            return data[:start] + rng.randbytes(end - start) + data[start:], (start, start + 1)
        case "zeroed tail":
            return data[:start] + bytes(size - start), (start, size)
        case "cut":
            return data[:start], (start, size)
    assert kind == "lengthened"
    return data + rng.randbytes(rng.randrange(1, 5000)), (size, size)
