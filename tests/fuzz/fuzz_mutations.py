"""Mutations of bytes: flips, cuts, insertions, repetitions, other numbers and words in the place of those that are there."""

from __future__ import annotations

import re
from collections.abc import Callable
from random import Random

NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.])")
WORD = re.compile(rb"[A-Za-z_]\w*")
NUMBERS = [
    b"nan", b"inf", b"-inf", b"NaN", b"null", b"true", b"-1", b"0", b"-0.0", b"1", b"2", b"1e308", b"-1e308", b"1e-320",
    b"1e400", b"2147483648", b"-2147483648", b"4294967296", b"9223372036854775808", b"99999999999999999999999999", b"1e9",
    b"0.5", b"1e-9", b"255", b"256", b"65536", b"1_000", b"1,5", b"0x10", b"", b"''", b"[1, 2]", b"{}", b"one", b"\xc2\xbd",
]  # fmt: skip
PIECES = [
    b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\r\n", b"\n\n", b"\t", b" ", b",", b";", b":", b"#", b"%", b'"', b"'", b"-", b"/",
    b"../", b"[", b"]", b"{", b"}", b"&a ", b"*a", b"!!python/object ", b"${oc.env:HOME}", b"\x1b[31m", b"\xe2\x80\xae", b"~",
    b"\xff" * 4, b"\x7f\xff\xff\xff", b"\x00\x00\x00\x80", b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f",
]  # fmt: skip


def mutated(data: bytes, rng: Random) -> bytes:
    """One to four mutations of some bytes, as the random numbers say."""
    for _ in range(rng.choice([1, 1, 1, 2, 3, 4])):
        data = rng.choice(MUTATIONS)(data, rng)
    return data


def _flip(data: bytes, rng: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice([1, 1, 2, 8])):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _cut(data: bytes, rng: Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _insert(data: bytes, rng: Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    piece = rng.choice(PIECES) if rng.random() < 0.7 else rng.randbytes(rng.choice([1, 4, 64]))
    return data[:at] + piece + data[at:]


def _span(data: bytes, rng: Random) -> tuple[int, int]:
    start = rng.randrange(len(data) + 1)
    return start, min(len(data), start + rng.choice([1, 2, 4, 16, 64, len(data)]))


def _delete(data: bytes, rng: Random) -> bytes:
    start, end = _span(data, rng)
    return data[:start] + data[end:]


def _repeat(data: bytes, rng: Random) -> bytes:
    start, end = _span(data, rng)
    return data[:start] + data[start:end] * rng.choice([2, 2, 3, 10]) + data[end:]


def _lines(data: bytes, rng: Random) -> bytes:
    lines = data.splitlines(keepends=True)
    if len(lines) > 1:
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        if rng.random() < 0.5:
            lines[i], lines[j] = lines[j], lines[i]
        else:
            lines.insert(i, lines[j])
    return b"".join(lines)


def _number(data: bytes, rng: Random) -> bytes:
    found = list(NUMBER.finditer(data))
    if not found:
        return _flip(data, rng)
    where = rng.choice(found)
    value = rng.choice(NUMBERS) if rng.random() < 0.8 else rng.choice(found)[0]
    return data[: where.start()] + value + data[where.end() :]


def _word(data: bytes, rng: Random) -> bytes:
    found = list(WORD.finditer(data))
    if not found:
        return _flip(data, rng)
    where, other = rng.choice(found), rng.choice(found)[0]
    value = rng.choice([other, other.upper(), where[0][:-1], where[0] + b"s", b""])
    return data[: where.start()] + value + data[where.end() :]


def _field(data: bytes, rng: Random) -> bytes:
    """A binary number of 1, 2, 4 or 8 bytes becomes one at the edge of its type."""
    size = rng.choice([1, 2, 4, 8])
    if len(data) < size:
        return data
    at = rng.randrange(len(data) - size + 1)
    value = rng.choice(
        [0, 1, 2 ** (8 * size) - 1, 2 ** (8 * size - 1), 2 ** (8 * size - 1) - 1, rng.getrandbits(8 * size)]
    )
    return data[:at] + value.to_bytes(size, rng.choice(["little", "big"])) + data[at + size :]


MUTATIONS: list[Callable[[bytes, Random], bytes]] = [
    _flip, _cut, _insert, _delete, _repeat, _lines, _number, _number, _number, _word, _field,
]  # fmt: skip
