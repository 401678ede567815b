"""Pose graphs as text: g2o (`VERTEX_SE2`, `EDGE_SE2`, `VERTEX_SE3:QUAT`, `EDGE_SE3:QUAT`) and TORO (`VERTEX2`, `EDGE2`).

Numbers are written so that they read back exactly. The information of g2o's spatial edges is taken to be about a rotation
vector, as GTSAM, Ceres and SE-Sync do; g2o's own error is half of that vector. What words mean: `omnilab.posegraph.tags`.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np

from omnilab.api import Floats, PoseGraph
from omnilab.errors import DataError
from omnilab.file_kinds import POSE_GRAPH, kind_of_file, opened
from omnilab.posegraph.graph import check_graph, dead_reckoning
from omnilab.posegraph.plausibility import check_convention
from omnilab.posegraph.tags import ORDERS, SKIPPED, TAGS, Tag, refusal

MOST_BYTES = 1 << 28
MOST_LINES = 2_000_000
LONGEST_LINE = 2_000  # characters


class Line(NamedTuple):
    """A vertex or an edge, and where it stands in the file."""

    number: int
    ids: tuple[int, ...]
    tag: Tag
    numbers: list[float]  # (k,) of the pose or motion, then of the information, as they stand in the line

    def same(self) -> tuple[object, ...]:
        """What two lines that measured the same have in common."""
        return self.ids, self.tag, *self.numbers


def read_graph(path: Path, notes: list[str] | None = None) -> PoseGraph:
    """The graph of a g2o or TORO file; DataError, with the line, for what cannot be used.

    Where a file has edges only, poses are chained from the first vertex, which is put at the origin. `notes` gets a
    sentence for whatever is read otherwise than it was written.
    """
    vertices: list[Line] = []
    edges: list[Line] = []
    skipped: list[tuple[int, str, list[str]]] = []
    tags: dict[int, str] = {}  # by how many numbers a pose has
    for number, word, values in _lines(path):
        if word in SKIPPED:
            skipped.append((number, word, values))
            continue
        tag = TAGS[word]
        tags.setdefault(tag.k, word)
        if len(tags) > 1:
            raise _error(path, number, f"is {word} in a {'spatial' if tag.k == 3 else 'planar'} graph", "use one kind")
        (vertices if tag.ids == 1 else edges).append(_parsed(path, number, word, tag, values))
    if not edges:
        raise DataError(
            f"{path} has no edge, so nothing joins its {len(vertices)} vertices; give a graph with EDGE lines"
        )
    (k,) = tags
    graph = _assembled(path, vertices, edges, k)
    sentences = [*_skipped(path, skipped, graph), *_repeated(path, edges)]
    _check_order(path, edges, graph)
    check_graph(graph, str(path))
    check_convention(graph, bool(vertices), str(path))
    if notes is not None:
        notes += sentences
    return graph if vertices else replace(graph, poses=dead_reckoning(graph))


def _lines(path: Path) -> Iterator[tuple[int, str, list[str]]]:
    """Line number, first word, and the other words."""
    try:
        if (kind := kind_of_file(path)) not in {None, POSE_GRAPH}:
            raise DataError(f"{path} is {kind}, no pose graph; give a g2o or TORO file")
        with io.TextIOWrapper(opened(path, MOST_BYTES), encoding="utf-8-sig") as file:
            for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE + 1), ""), 1):
                word, *values = (line.partition("#")[0] if "#" in line else line).split() or [""]
                if word not in TAGS and word and word not in SKIPPED:
                    raise _error(path, number, *refusal(word))
                if number > MOST_LINES or len(line) > LONGEST_LINE:
                    raise _error(path, number, f"is beyond {MOST_LINES} lines of {LONGEST_LINE} characters", "split it")
                if word:
                    yield number, word, values
    except UnicodeDecodeError:
        raise DataError(f"{path} is no text in UTF-8; give a g2o or TORO file") from None
    except OSError as error:
        raise DataError(f"the graph {path} cannot be read ({error.strerror}); give another path") from error


def _skipped(path: Path, lines: list[tuple[int, str, list[str]]], graph: PoseGraph) -> Iterator[str]:
    """What is not done about FIX and EQUIV lines, in sentences; DataError for FIX lines that cannot be met."""
    fixed: dict[int, int] = {}  # vertex: line
    for number, word, values in lines:
        if word == "FIX":
            try:
                named = [int(value) for value in values]
            except ValueError as error:
                raise _error(path, number, f"has no id where one belongs ({error})", "write FIX and an id") from None
            if not named or (strange := set(named) - set(graph.ids.tolist())):
                what = f"vertex {min(strange)}, which the file does not place" if named else "no vertex"
                raise _error(path, number, f"fixes {what}", "write FIX and the id of a vertex")
            fixed |= {i: number for i in named if i not in fixed}
    if len(fixed) > 1:
        (first, _), (second, number), *_ = fixed.items()
        raise _error(
            path, number, f"fixes a second vertex, {second} beside {first}, and one vertex can stay", "leave one id"
        )
    if fixed and (stays := int(graph.ids[0])) not in fixed:
        yield (
            f"FIX {next(iter(fixed))} is not followed: the first vertex, {stays}, stays; chi2 and the map's shape are"
            " the same, all of it is moved"
        )
    if count := sum(word == "EQUIV" for _, word, _ in lines):
        yield f"{count} EQUIV lines are left out: their vertices stay two; an edge without a motion would join them"


def _repeated(path: Path, edges: list[Line]) -> Iterator[str]:
    """A sentence for edges that stand in the file again, number by number: they count again."""
    first: dict[tuple[object, ...], int] = {}
    again = [(line.number, first.setdefault(line.same(), line.number)) for line in edges]
    twice = [(number, before) for number, before in again if number != before]
    if twice:
        number, before = twice[0]
        yield (
            f"{len(twice)} of {len(edges)} edges of {path} repeat another (line {number} repeats line {before}); each"
            " counts, so remove those that are one measurement"
        )


def _parsed(path: Path, number: int, word: str, tag: Tag, values: list[str]) -> Line:
    """A line's ids and numbers."""
    count = tag.ids + tag.k + len(tag.upper)
    if len(values) != count:
        parts = f": {tag.ids} ids, {tag.k} of the motion, {len(tag.upper)} of the information's triangle"
        raise _error(
            path, number, f"has {len(values)} values after {word}", f"write {count}{parts if tag.upper else ''}"
        )
    try:
        ids, numbers = tuple(map(int, values[: tag.ids])), list(map(float, values[tag.ids :]))
    except ValueError as error:
        raise _error(
            path, number, f"has no number where one belongs ({error})", "write whole ids, then numbers"
        ) from None
    if not (min(ids) >= 0 and max(ids) < 2**63):
        raise _error(path, number, f"has the id {min(ids)}", "write ids from 0 to 2^63 - 1")
    if not all(map(isfinite, numbers)):  # a tenth of the time of numpy's, of so few
        raise _error(path, number, "has NaN or infinity", "write finite numbers")
    return Line(number, ids, tag, numbers)


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
    poses = np.array([line.numbers for line in lines] or [origin] * len(ids))
    numbers = np.array([line.numbers for line in edges])
    upper, tags = numbers[:, k:], {line.tag for line in edges}
    for tag in tags:
        rows = [line.tag == tag for line in edges] if len(tags) > 1 else slice(None)
        upper[rows] = upper[rows][:, tag.upper]
    motions = numbers[:, :k].copy()
    return PoseGraph(ids, poses, np.searchsorted(ids, joined), motions, _symmetric(upper, 3 if k == 3 else 6))


def _check_order(path: Path, edges: list[Line], graph: PoseGraph) -> None:
    """DataError where information is positive definite in another order of its numbers alone."""
    if _positive(graph.information):
        return
    tag = edges[0].tag
    numbers = np.array([line.numbers for line in edges])[:, tag.k :]
    for name, order in ORDERS[tag.k].items():
        if order != tag.upper and _positive(_symmetric(numbers[:, order], graph.information.shape[1])):
            own = next(own for own, upper in ORDERS[tag.k].items() if upper == tag.upper)
            tags = [word for word, other in TAGS.items() if other == Tag(2, tag.k, order)]
            raise DataError(
                f"{path} has information that is positive definite as {name}, and not as {own}, as it is read; write it"
                f" so{f', or {tags[0]} for these edges' if tags else ''}"
            )


def _positive(W: Floats) -> bool:
    """Whether all matrices (E, d, d) are positive definite."""
    try:
        np.linalg.cholesky(W)
    except np.linalg.LinAlgError:
        return False
    return True


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
