"""Pose graphs as text: g2o (`VERTEX_SE2`, `EDGE_SE2`, `VERTEX_SE3:QUAT`, `EDGE_SE3:QUAT`) and TORO (`VERTEX2`, `EDGE2`).

Numbers are written so that they read back exactly. The information of g2o's spatial edges is taken to be about a rotation
vector, as GTSAM, Ceres and SE-Sync do; g2o's own error is half of that vector.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, PoseGraph
from omnilab.errors import DataError, did_you_mean
from omnilab.posegraph.graph import check_graph, dead_reckoning

MOST_BYTES = 1 << 28
MOST_LINES = 2_000_000
LONGEST_LINE = 2_000  # characters
IGNORED = ("EQUIV", "FIX")  # TORO: two names of a place; g2o: the vertex that stays, and here the first one does


class Tag(NamedTuple):
    """What a line's first word says."""

    ids: int  # 1: a vertex, 2: an edge
    k: int  # numbers of a pose or motion
    upper: tuple[int, ...] = ()  # where the information's upper triangle, row by row, stands among the numbers after


TAGS = {
    "VERTEX_SE2": Tag(1, 3),
    "EDGE_SE2": Tag(2, 3, tuple(range(6))),
    "VERTEX_SE3:QUAT": Tag(1, 7),
    "EDGE_SE3:QUAT": Tag(2, 7, tuple(range(21))),
    "VERTEX2": Tag(1, 3),
    "EDGE2": Tag(2, 3, (0, 1, 4, 2, 5, 3)),  # the file has xx xy yy hh xh yh
}


class Line(NamedTuple):
    """A vertex or an edge, and where it stands in the file."""

    number: int
    ids: tuple[int, ...]
    pose: list[float]  # (k,), or a motion
    upper: list[float]  # the information's triangle, row by row


def read_graph(path: Path) -> PoseGraph:
    """The graph of a g2o or TORO file; DataError, with the line, for what cannot be used.

    Where a file has edges only, poses are chained from the first vertex, which is put at the origin.
    """
    vertices: list[Line] = []
    edges: list[Line] = []
    tags: dict[int, Tag] = {}  # by how many numbers a pose has
    for number, word, tag, values in _lines(path):
        other = tags.setdefault(tag.k, tag)
        if len(tags) > 1:
            raise _error(
                path, number, f"is {word} in a {'planar' if other.k == 7 else 'spatial'} graph", "use one kind"
            )
        (vertices if tag.ids == 1 else edges).append(_parsed(path, number, word, tag, values))
    if not edges:
        raise DataError(
            f"{path} has no edge, so nothing joins its {len(vertices)} vertices; give a graph with EDGE lines"
        )
    (k,) = tags
    graph = _assembled(path, vertices, edges, k)
    check_graph(graph, str(path))
    return graph if vertices else replace(graph, poses=dead_reckoning(graph))


def _lines(path: Path) -> Iterator[tuple[int, str, Tag, list[str]]]:
    """Line number, first word, what that word means, and the other words."""
    fixed = 0
    try:
        if path.stat().st_size > MOST_BYTES:
            raise DataError(f"{path} is larger than {MOST_BYTES >> 20} MiB; give a smaller graph")
        with path.open(encoding="utf-8") as file:
            for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE + 1), ""), 1):
                if number > MOST_LINES or len(line) > LONGEST_LINE:
                    raise _error(path, number, f"is beyond {MOST_LINES} lines of {LONGEST_LINE} characters", "split it")
                word, *values = line.partition("#")[0].split() or [""]
                if word == "FIX" and (fixed := fixed + 1) > 1:
                    raise _error(path, number, "fixes a second vertex", "leave FIX lines out; the first vertex stays")
                if not word or word in IGNORED:
                    continue
                if word not in TAGS:
                    raise _error(
                        path, number, f"starts with {word[:40]!r}{did_you_mean(word, TAGS)}",
                        f"known are {', '.join([*TAGS, *IGNORED])}",
                    )  # fmt: skip
                yield number, word, TAGS[word], values
    except UnicodeDecodeError as error:
        raise DataError(f"{path} is no text ({error.reason}); give a g2o or TORO file") from None
    except OSError as error:
        raise DataError(f"the graph {path} cannot be read ({error.strerror}); give another path") from error


def _parsed(path: Path, number: int, word: str, tag: Tag, values: list[str]) -> Line:
    """A line's ids and numbers."""
    count = tag.ids + tag.k + len(tag.upper)
    if len(values) != count:
        raise _error(path, number, f"has {len(values)} values after {word}", f"write {count}")
    try:
        ids, numbers = tuple(map(int, values[: tag.ids])), list(map(float, values[tag.ids :]))
    except ValueError as error:
        raise _error(
            path, number, f"has no number where one belongs ({error})", "write whole ids, then numbers"
        ) from None
    if not all(0 <= i < 2**63 for i in ids):
        raise _error(path, number, f"has the id {min(ids)}", "write ids from 0 to 2^63 - 1")
    if not np.isfinite(numbers).all():
        raise _error(path, number, "has NaN or infinity", "write finite numbers")
    pose, rest = numbers[: tag.k], numbers[tag.k :]
    return Line(number, ids, pose, [rest[i] for i in tag.upper])


def _assembled(path: Path, vertices: list[Line], edges: list[Line], k: int) -> PoseGraph:
    """Rows in the order of ids, edges in the order of the file."""
    lines = sorted(vertices, key=lambda line: line.ids)
    ids = np.array([line.ids[0] for line in lines], np.int64)
    joined = np.array([line.ids for line in edges], np.int64)
    if (again := np.flatnonzero(np.diff(ids) == 0)).size:
        twice = lines[again[0] + 1]
        raise _error(path, twice.number, f"gives vertex {twice.ids[0]} a second time", "remove one")
    if not vertices:
        ids = np.unique(joined)
    unknown = ~np.isin(joined, ids)
    if unknown.any():
        row, side = np.argwhere(unknown)[0]
        raise _error(
            path, edges[row].number, f"joins vertex {joined[row, side]}, which the file does not place",
            "add its VERTEX line, or leave all VERTEX lines out",
        )  # fmt: skip
    origin = [0.0] * (k - 1) + [float(k == 7)]
    poses = np.array([line.pose for line in lines] or [origin] * len(ids))
    motions, upper = (np.array(column) for column in zip(*((line.pose, line.upper) for line in edges), strict=True))
    return PoseGraph(ids, poses, np.searchsorted(ids, joined), motions, _symmetric(upper, 3 if k == 3 else 6))


def _symmetric(upper: Floats, d: int) -> Floats:
    """Matrices (E, d, d) of their upper triangles (E, d (d + 1) / 2), row by row."""
    W = np.zeros((len(upper), d, d))
    row, column = np.triu_indices(d)
    W[:, row, column] = W[:, column, row] = upper
    return W


def _error(path: Path, number: int, problem: str, remedy: str) -> DataError:
    return DataError(f"line {number} of {path} {problem}; {remedy}")


# ------------------------------------------------------------------------------------------------------------- writing
def g2o_text(graph: PoseGraph) -> str:
    """A graph as a g2o file."""
    kind = "SE2" if graph.planar else "SE3:QUAT"
    row, column = np.triu_indices(graph.information.shape[1])
    return _text(graph, f"VERTEX_{kind}", f"EDGE_{kind}", graph.information[:, row, column])


def toro_text(graph: PoseGraph) -> str:
    """A planar graph as a TORO file; DataError for a spatial one."""
    if not graph.planar:
        raise DataError("a spatial graph cannot be written as TORO text, which is planar here; write g2o")
    row, column = np.array([[0, 0, 1, 2, 0, 1], [0, 1, 1, 2, 2, 2]])
    return _text(graph, "VERTEX2", "EDGE2", graph.information[:, row, column])


def _text(graph: PoseGraph, vertex: str, edge: str, numbers: Floats) -> str:
    """Vertices, then edges with their information as `numbers` (E, n)."""
    lines = [_line(vertex, [i], pose) for i, pose in zip(graph.ids.tolist(), graph.poses.tolist(), strict=True)]
    ends = graph.ids[graph.edges].tolist()
    values = np.concatenate([graph.motions, numbers], axis=1).tolist()
    lines += [_line(edge, ids, row) for ids, row in zip(ends, values, strict=True)]
    return "\n".join([*lines, ""])


def _line(tag: str, ids: Iterable[int], numbers: Iterable[float]) -> str:
    return " ".join([tag, *map(str, ids), *map(repr, numbers)])
