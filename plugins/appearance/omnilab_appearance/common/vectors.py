"""Normalisation of vectors."""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats


def unit(vectors: Floats) -> Floats:
    """Vectors (N, D) scaled to unit length; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0))
