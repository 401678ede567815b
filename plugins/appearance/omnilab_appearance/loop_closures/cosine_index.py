"""An incremental index of vectors under the cosine distance."""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats


class CosineIndex:
    """Unit vectors (n, D) in an array that doubles as it fills."""

    def __init__(self) -> None:
        self._rows = np.zeros((64, 0), np.float32)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, vector: Floats) -> None:
        """Append a vector (D,), scaled to unit length; a zero vector stays zero, at distance 1 from all."""
        if self._rows.shape[1] != vector.size:
            self._rows = np.zeros((len(self._rows), vector.size), np.float32)
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self._count] = vector.ravel() / max(float(np.linalg.norm(vector)), 1e-12)
        self._count += 1

    def distances(self, exclude: int) -> Floats:
        """Cosine distances (m,) of the last one from all but the `exclude` before it (Berenguer, thesis, eq. 6.6)."""
        last = self._count - 1
        return np.asarray(1 - self._rows[: max(0, last - exclude)] @ self._rows[last])
