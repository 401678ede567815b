"""The fields of a protobuf message, without knowing its schema."""

from __future__ import annotations

from typing import Any

Field = Any  # a whole number, or bytes


MOST_FIELDS = 100  # of a message; those of recordings have less than ten


def fields(message: bytes) -> dict[int, Field]:
    """The last field of each number; ValueError if the message is not whole, or has more than MOST_FIELDS."""
    found, at = dict[int, Field](), 0
    for _ in range(MOST_FIELDS):
        if at == len(message):
            return found
        key, at = _varint(message, at)
        match key & 7:
            case 0:
                found[key >> 3], at = _varint(message, at)
                continue
            case 1:
                length = 8
            case 2:
                length, at = _varint(message, at)
            case 5:
                length = 4
            case kind:
                raise ValueError(f"no field is of kind {kind}")
        if at + length > len(message):
            raise ValueError("a field is torn")
        found[key >> 3] = message[at : at + length]
        at += length
    raise ValueError("there are too many fields")


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """A number of seven bits a byte, and where it ends."""
    number = 0
    for i, byte in enumerate(message[at : at + 10]):
        number |= (byte & 0x7F) << 7 * i
        if byte < 0x80:
            return number, at + i + 1
    raise ValueError("a number is torn")
