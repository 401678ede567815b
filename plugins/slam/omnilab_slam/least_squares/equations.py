"""Normal equations of pose graphs: assembled from what each edge adds, factorised in an order that is worked out once."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from omnilab.api import Ints

MANY = 10_000  # poses from which nested dissection, in 20 ms a thousand more, repays itself within three factorisations
PANEL = 4  # columns that SuperLU takes at a time: factors are so sparse that its usual 20 take up to a sixth longer
Numbers = npt.NDArray[Any]  # real or complex


class Factor(NamedTuple):
    """Normal equations that are factorised: solutions take a tenth of the time."""

    lu: Any  # scipy.sparse.linalg.SuperLU
    order: Ints  # (N - 1,) poses but the first

    def solve(self, right: Numbers) -> Numbers:
        """x (N - 1, d, c) of all poses but the first, for a right side (N, d, c)."""
        x = np.empty_like(right[1:])
        rows = right[self.order]
        x[self.order - 1] = self.lu.solve(rows.reshape(-1, right.shape[2])).reshape(rows.shape)
        return x


class PoseEquations:
    """Normal equations of a pose graph of N poses: a block for each pose but the first, which stays, and for each edge.

    The order of elimination is GTSAM's of the poses, worked out once: SuperLU's own of all variables takes time that grows with the
    square of their number.
    """

    def __init__(self, edges: Ints, count: int) -> None:
        self._edges, self._order = edges, elimination_order(edges, count)
        place = np.full(count, -1)
        place[self._order] = np.arange(count - 1)
        rows, columns = np.repeat(place[edges], 2, axis=1).ravel(), np.tile(place[edges], 2).ravel()  # of (E, 2, 2)
        kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        cells = columns[kept] * count + rows[kept]
        by_cell = np.argsort(cells, kind="stable")
        self._summands, cells = kept[by_cell], cells[by_cell]
        self._starts = np.flatnonzero(np.diff(cells, prepend=-1))
        blocks = cells[self._starts]
        self._rows = (blocks % count).astype(np.int32)
        self._columns = np.searchsorted(blocks // count, np.arange(count)).astype(np.int32)
        self._diagonal = np.flatnonzero(blocks // count == blocks % count)

    def factor(self, H: Numbers, damping: float = 0.0) -> Factor:
        """The sum of the edges' H (E, 2, 2, d, d), its diagonal raised; RuntimeError where it is singular."""
        from scipy.sparse import bsr_array, csc_array
        from scipy.sparse.linalg import splu

        d = H.shape[-1]
        summands = H.reshape(-1, d, d)[self._summands]
        blocks = np.add.reduceat(summands, self._starts, axis=0)
        k = np.arange(d)
        blocks[self._diagonal[:, None], k, k] *= 1 + damping
        # a transposed matrix's rows are the columns
        columns = bsr_array((np.swapaxes(blocks, 1, 2), self._rows, self._columns), shape=(d * len(self._order),) * 2)
        rows = columns.tocsr()
        matrix = csc_array((rows.data, rows.indices, rows.indptr), shape=rows.shape)
        lu = splu(
            matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, panel_size=PANEL, options={"SymmetricMode": True}
        )
        return Factor(lu, self._order)

    def right(self, g: Numbers) -> Numbers:
        """The right side (N, d, c) of what each edge adds to those of its two poses, (E, 2, d, c)."""
        out = np.empty((len(self._order) + 1, *g.shape[2:]), g.dtype)
        ends = self._edges.ravel()
        for at in np.ndindex(g.shape[2:]):
            values = g[(slice(None), slice(None), *at)].ravel()
            out[(slice(None), *at)] = np.bincount(ends, values.real, len(out))
            if np.iscomplexobj(g):
                out[(slice(None), *at)] += 1j * np.bincount(ends, values.imag, len(out))
        return out


def elimination_order(edges: Ints, count: int) -> Ints:
    """The poses (N - 1,) but the first in an order that leaves a sparse factor.

    COLAMD (Davis et al., 2004), of many poses nested dissection (METIS; Karypis and Kumar, 1998).
    """
    import gtsam

    graph = gtsam.SymbolicFactorGraph()
    for i, j in edges.tolist():
        graph.push_factor(i, j)
    kind = gtsam.Ordering
    order = (kind.MetisSymbolicFactorGraph if count >= MANY else kind.ColamdSymbolicFactorGraph)(graph)
    found = np.array([order.at(k) for k in range(order.size())], int)
    return found[found > 0]
