"""Small files that claim, or unpack to, more than any memory; and what reads each. Run in a process of few bytes."""

from __future__ import annotations

import json
import os
import resource
import signal
import struct
import sys
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from omnilab.api import Places, RecordedPoses, Signatures
from omnilab.cameras import load_camera
from omnilab.errors import OmnilabError
from omnilab.posegraph.files import read_graph
from omnilab.runner.map_file import load_places, save_map
from omnilab.runner.run_folder import load_run
from omnilab.trajectory.files import read_trajectory
from omnilab_mcap.repair import repair
from omnilab_mirror.scene.load import load_world
from omnilab_recordings import Folder
from omnilab_studies.view_slam.scenarios import scenario

MEMORY = 1 << 30  # bytes, beside what the process has when it begins
SECONDS = 60  # on a busy machine
DEEP = 200_000  # brackets
LONG = 64 << 20  # bytes
ABOUT = {"components": {}, "config": {}}


def map_of(folder: Path) -> Any:
    return load_places(folder / "map.npz")


def images_of(folder: Path) -> Any:
    sensor = Folder(path=str(folder))
    return [frames.images.shape for frames in sensor.frames(sensor.plan(RecordedPoses()))]


def run_of(folder: Path) -> Any:
    run = load_run(folder)
    return run.status, run.manifest, run.config, run.metrics


def reader(name: str) -> Callable[[Path], Any]:
    """By what the name of a file says."""
    kind = Path(name).suffix
    if name in {"status.json", "manifest.json", "config.yaml", "metrics.csv"}:
        return run_of
    if name in {"camera.json", "camera.yaml"}:
        return lambda folder: load_camera(folder / name)
    if name == "scenario.yaml":
        return lambda folder: scenario(str(folder / name))
    if kind in {".obj", ".glb", ".ply", ".yaml"}:
        return lambda folder: load_world(str(folder / name))
    if kind == ".g2o":
        return lambda folder: read_graph(folder / name)
    if kind in {".csv", ".tum"}:
        return lambda folder: read_trajectory(folder / name)
    if kind == ".mcap":
        return lambda folder: repair(folder / name)
    return map_of if kind == ".npz" else images_of


# ---------------------------------------------------------------------------------------------------------- the files
def png(width: int, height: int, *chunks: bytes) -> bytes:
    """Black, of one bit a pixel."""
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0))
    data = chunk(b"IDAT", zeros((1 + width // 8) * height))
    return b"\x89PNG\r\n\x1a\n" + head + b"".join(chunks) + data + chunk(b"IEND", b"")


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def zeros(size: int = 1 << 31) -> bytes:
    """What zlib makes of so many zeros: one block of them, again and again."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    block = packer.compress(bytes(1 << 22)) + packer.flush(zlib.Z_FULL_FLUSH)
    rest = packer.compress(bytes(size % (1 << 22))) + packer.flush()
    checksum = struct.pack(">HH", size % 65521, 1)
    return b"\x78\xda" + block * (size >> 22) + rest + checksum


def sound_map(folder: Path) -> bytes:
    save_map(folder / "map.npz", Places(Signatures(np.ones((2, 3), np.float32)), None, ["a", "b"]), ABOUT)
    return (folder / "map.npz").read_bytes()


def packed_map(folder: Path) -> bytes:
    """Compressed."""
    with zipfile.ZipFile(folder / "map.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("about.npy", bytes(1 << 26))
    return (folder / "map.npz").read_bytes()


def map_of_members(folder: Path, count: int = 400_000) -> bytes:
    """An archive that lists one member again and again."""
    data = sound_map(folder)
    start, end = data.index(b"PK\1\2"), data.rindex(b"PK\5\6")
    entry = data[start : data.index(b"PK\1\2", start + 4)]
    tail = bytearray(data[end : end + 22])
    tail[12:16] = (len(entry) * count).to_bytes(4, "little")
    return data[:start] + entry * count + bytes(tail)


def map_that_overlaps(folder: Path) -> bytes:
    """Members that all lie in the same bytes."""
    with zipfile.ZipFile(folder / "map.npz", "w") as archive, archive.open("a.npy", "w") as out:
        np.lib.format.write_array(out, np.zeros(8 << 20, np.uint8))
    data = (folder / "map.npz").read_bytes()
    start, end = data.index(b"PK\1\2"), data.rindex(b"PK\5\6")
    entries = b"".join(data[start:end].replace(b"a.npy", b"%05d" % i) for i in range(2000))
    tail = bytearray(data[end:])
    tail[8:12] = struct.pack("<HH", 2000, 2000)
    tail[12:16] = len(entries).to_bytes(4, "little")
    return data[:start] + entries + bytes(tail)


def glb(content: dict[str, Any], binary: bytes = b"") -> bytes:
    return glb_of_text(json.dumps({"asset": {"version": "2.0"}} | content).encode(), binary)


def glb_of_text(text: bytes, binary: bytes = b"") -> bytes:
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(binary), b"BIN\0") + binary if binary else b""
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def triangle(nodes: list[Any], count: int = 3, **more: Any) -> bytes:
    """A triangle in nodes of any kind."""
    accessor = {"componentType": 5126, "type": "VEC3", "count": count, "bufferView": 0, **more}
    return glb(
        {
            "scenes": [{"nodes": [0]}],
            "nodes": nodes,
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [accessor],
            "bufferViews": [{"buffer": 0, "byteLength": 36}],
            "buffers": [{"byteLength": 36}],
        },
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes(),
    )


def doubling(depth: int = 40) -> list[dict[str, Any]]:
    """Nodes that hold the next one twice, which holds the next one twice."""
    return [{"children": [i + 1, i + 1]} for i in range(depth)] + [{"mesh": 0}]


def brackets(before: str = "", after: str = "") -> bytes:
    return f"{before}{'[' * DEEP}{']' * DEEP}{after}".encode()


def aliases(levels: int = 12) -> bytes:
    """Nine of nine of nine."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, levels)]
    return "\n".join(lines).encode()


def mcap_chunk(compression: bytes, uncompressed: int, data: bytes) -> bytes:
    """A log with one chunk."""
    head = b"\x89MCAP0\r\n" + b"\x01" + struct.pack("<Q", 8) + struct.pack("<II", 0, 0)
    body = (
        struct.pack("<QQQII", 0, 0, uncompressed, 0, len(compression))
        + compression
        + struct.pack("<Q", len(data))
        + data
    )
    return head + b"\x06" + struct.pack("<Q", len(body)) + body


def zstd_of_zeros(size: int) -> bytes:
    import zstandard

    packer = zstandard.ZstdCompressor().compressobj()
    return b"".join(packer.compress(bytes(1 << 24)) for _ in range(size >> 24)) + packer.flush()


STATUS = b'{"status": "done", "pid": 1}'
GRAPH = "EDGE_SE2 {} {} 1 0 0 1 0 0 1 0 1\n"
OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
PLY = "ply\nformat {}\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n{}end_header\n"
FACES = "property list uint int vertex_indices\n"
BMP = b"BM" + struct.pack("<IHHIIiiHHII", 70, 0, 0, 54, 40, 100_000, 100_000, 1, 24, 0, 0) + bytes(24)
JPEG = (
    b"\xff\xd8\xff\xc0\0\x0b\x08\xff\xdc\xff\xdc\x01\x01\x11\0\xff\xda\0\x08\x01\x01\0\0\x3f\0"
    + bytes(1000)
    + b"\xff\xd9"
)
TIFF = b"II*\0\x08\0\0\0" + struct.pack(
    "<H" + "HHII" * 8, 8, 256, 4, 1, 200_000, 257, 4, 1, 200_000, 258, 3, 1, 8, 259, 3, 1, 8, 262, 3, 1, 1, 273, 4, 1, 120, 278,
    4, 1, 200_000, 279, 4, 1, 100,
) + bytes(200)  # fmt: skip
WEBP = (
    b"RIFF" + struct.pack("<I", 4 + 8 + 30) + b"WEBPVP8L" + struct.pack("<I", 30) + b"\x2f\xff\xff\xff\x0f" + bytes(25)
)

BOMBS: dict[str, Callable[[Path], bytes]] = {  # name of the file, a colon, what it is: its content
    "map.npz: compressed": packed_map,
    "map.npz: many members": map_of_members,
    "map.npz: members that overlap": map_that_overlaps,
    "a.png: 60000 x 60000": lambda _: png(60_000, 60_000),
    "a.png: text of 2 GB": lambda _: png(16, 1000, chunk(b"zTXt", b"Comment\0\0" + zeros())),
    "a.png: profile of 2 GB": lambda _: png(16, 1000, chunk(b"iCCP", b"a\0\0" + zeros())),
    "a.jpg: 65500 x 65500": lambda _: JPEG,
    "a.tif: 200000 x 200000": lambda _: TIFF,
    "a.webp: 16384 x 16384": lambda _: WEBP,
    "a.bmp: 100000 x 100000": lambda _: BMP,
    "a.pgm: 100000 x 100000": lambda _: b"P5 100000 100000 255\n" + bytes(100),
    "a.pgm: a huge number": lambda _: b"P5 " + b"9" * 10_000_000 + b" 1 255\n",
    "a.glb: nodes that double": lambda _: triangle(doubling()),
    "a.glb: a circle of nodes": lambda _: triangle([{"children": [1], "mesh": 0}, {"children": [0], "mesh": 0}]),
    "a.glb: a chain of nodes": lambda _: triangle([{"children": [i + 1]} for i in range(50_000)] + [{"mesh": 0}]),
    "a.glb: a count of 2^32": lambda _: triangle([{"mesh": 0}], 2**32),
    "a.glb: zeros without a buffer": lambda _: triangle([{"mesh": 0}], 3 * 10**9, bufferView=None).replace(
        b', "bufferView": null', b' ' * 20
    ),
    "a.glb: brackets": lambda _: glb_of_text(brackets()),
    "a.obj: a huge index": lambda _: OBJ + b"f 1 2 999999999999999999\n",
    "a.obj: one line": lambda _: OBJ + b"f" + b" 1 2 3" * (LONG // 6),
    "a.obj: no number": lambda _: OBJ + b"v " + b"9" * LONG,
    "a.ply: 4e9 vertices": lambda _: PLY.format("binary_little_endian 1.0", 4 * 10**9, 1, FACES).encode() + bytes(100),
    "a.ply: 4e9 faces in ASCII": lambda _: PLY.format("ascii 1.0", 3, 4 * 10**9, FACES).encode() + b"0 0 0\n1 0 0\n0 1 0\n",
    "a.ply: a face of 4e9": lambda _: PLY.format("binary_little_endian 1.0", 3, 1, FACES).encode() + bytes(36) + b"\xff" * 8,
    "a.ply: a million elements": lambda _: b"ply\nformat ascii 1.0\n" + b"element a 1000000000\n" * 500_000 + b"end_header\n",
    "world.yaml: brackets": lambda _: brackets("objects: "),
    "world.yaml: aliases": lambda _: aliases(),
    "world.yaml: a large map": lambda _: b"map_m: [1.0e+9, 1.0e+9]\nobjects: [{kind: floor}]\ntexels_per_m: 10000\n",
    "scenario.yaml: brackets": lambda _: brackets("path_m: ")[:90_000],
    "scenario.yaml: aliases": lambda _: aliases(),
    "scenario.yaml: small steps": lambda _: b"path_m: [[0,0],[1e9,0],[0,1e9]]\nwalls_m: []\nstep_m: 1.0e-9\n"
    b"odometry: {along_m: 1, across_m: 1, heading_deg: 1, turn_deg: 1}\n",
    "camera.json: brackets": lambda _: brackets(),
    "camera.yaml: brackets": lambda _: brackets("cam0: "),
    "camera.yaml: aliases": lambda _: aliases(),
    "camera.json: a huge number": lambda _: b'{"model": "PinholeCamera", "width": ' + b"9" * 900_000 + b"}",
    "status.json: brackets": lambda _: brackets(),
    "manifest.json: brackets": lambda _: brackets(),
    "config.yaml: brackets": lambda _: brackets("study: "),
    "config.yaml: aliases": lambda _: aliases() + b"\nstudy: {}",
    "config.yaml: long": lambda _: b"a: 1\n" * (LONG // 5),
    "metrics.csv: one line": lambda _: b"metric,value,unit\n" + b"a" * LONG,
    "a.g2o: far ids": lambda _: "".join(GRAPH.format(i * 2**40, (i + 1) * 2**40) for i in range(1000)).encode()
    + b"VERTEX_SE2 0 0 0 0\n",
    "a.g2o: one line": lambda _: b"EDGE_SE2 " + b"1 " * (LONG // 2),
    "a.g2o: zeros": lambda _: bytes(LONG),
    "a.csv: one line": lambda _: b"x_m,y_m\n" + b"1," * (LONG // 2),
    "a.csv: one quotation": lambda _: b'x_m,y_m\n"' + b"1" * LONG,
    "a.csv: zeros": lambda _: bytes(LONG),
    "a.tum: one line": lambda _: b"1 " * (LONG // 2),
    "a.mcap: a chunk of 1 TB": lambda _: mcap_chunk(b"", 1 << 40, b"x" * 100),
    "a.mcap: zstd of 2 GB": lambda _: mcap_chunk(b"zstd", 1 << 31, zstd_of_zeros(1 << 31)),
    "a.mcap: zstd that claims less": lambda _: mcap_chunk(b"zstd", 100, zstd_of_zeros(1 << 31)),
}  # fmt: skip


def make(name: str, folder: Path) -> Path:
    """The file of a bomb, in a folder where it is read."""
    file = folder / name.partition(":")[0]
    data = BOMBS[name](folder)
    if reader(file.name) is run_of:
        (folder / "status.json").write_bytes(STATUS)
        (folder / "manifest.json").write_text('{"experiment": "a", "overrides": []}')
        (folder / "config.yaml").write_text("study: {}")
    file.write_bytes(data)
    return file


# ------------------------------------------------------------------------------------------------------- the process
def warm() -> None:
    """Have all libraries loaded, which takes more than is allowed afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "a.glb").write_bytes(triangle([{"mesh": 0}]))
        load_world(f"{folder}/a.glb")


warm()


def read(name: str, folder: Path, result: Connection) -> None:
    """Read a bomb with little memory; send what came of it, seconds, and bytes at the most beside those at the start."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    cv2.setNumThreads(1)
    size, resident = (int(n) * resource.getpagesize() for n in Path("/proc/self/statm").read_text().split()[:2])
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, size + MEMORY))
    signal.alarm(SECONDS)
    start = time.perf_counter()
    try:
        found = f"read: {str(reader(name.partition(':')[0])(folder))[:80]}"
    except OmnilabError as error:
        found = f"sentence: {error}"
    except BaseException as error:  # noqa: BLE001  which is what is looked for
        found = f"{type(error).__name__}: {error}"[:300]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    result.send((found, time.perf_counter() - start, max(0, peak - resident)))
