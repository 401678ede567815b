"""Mutations within containers whose checksums and lengths are right again: archives of arrays, PNG, GLB."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from random import Random

from fuzz_mutations import mutated


def in_npz(data: bytes, rng: Random) -> bytes:
    """One member of an uncompressed archive is mutated, left out or named otherwise."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    name = rng.choice(list(members))
    content = members.pop(name)
    if rng.random() < 0.9:
        other = rng.choice([name, name, name, *members])
        head = 128 if rng.random() < 0.5 and len(content) > 128 else 0  # the header stays as it is
        members[other] = content[:head] + mutated(content[head:], rng)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for key, value in members.items():
            archive.writestr(key, value)
    return out.getvalue()


def in_png(data: bytes, rng: Random) -> bytes:
    """One chunk of a PNG is mutated, or the pixels within the compressed ones."""
    chunks, at = [], 8
    while at + 8 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    which = rng.randrange(len(chunks))
    kind, content = chunks[which]
    if kind == b"IDAT" and rng.random() < 0.5:
        content = zlib.compress(mutated(zlib.decompress(content), rng))
    else:
        content = mutated(content, rng)
    chunks[which] = (kind, content)
    if rng.random() < 0.1:
        chunks.insert(which, rng.choice(chunks))
    return data[:8] + b"".join(
        struct.pack(">I", len(c)) + k + c + struct.pack(">I", zlib.crc32(k + c)) for k, c in chunks
    )


def in_glb(data: bytes, rng: Random) -> bytes:
    """The JSON of a GLB, or its numbers, is mutated."""
    (length,) = struct.unpack("<I", data[12:16])
    text, rest = data[20 : 20 + length], data[28 + length :]
    if rng.random() < 0.8:
        text = mutated(text, rng)
        text += b" " * (-len(text) % 4)
    else:
        rest = mutated(rest, rng)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(rest), 0x004E4942) + rest
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body
