"""Weighted metric and city block distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, check_settings, setting
from omnilab_appearance.distances.vector_distance import VectorDistance


@dataclass
class Weighted(VectorDistance):
    """Weighted metric (sum_i w^i |r_i - s_i|^p)^(1/p), i = 0, 1 ... (Payá et al., 2016, eq. 7).

    `decay=1` is the Minkowski distance; the paper also takes 0.95 with p = 2 or 3, which leaves about the first hundred
    components. The rotation comes from the headings, where there are any.
    """

    p: int = setting(3, at_least=1, at_most=16)  # the power
    decay: float = setting(
        0.95, above=0, at_most=1
    )  # w: component i counts w to the power of i; its paper's numbering, from 1, differs by a factor

    def __post_init__(self) -> None:
        check_settings(self)

    def _distances(self, queries: Floats, places: Floats) -> Floats:
        from omnilab_appearance.common.kernels import power_sums

        weights = self.decay ** np.arange(places.shape[1], dtype=np.float32)
        counted = weights > 1e-12  # the rest is below rounding
        sums = power_sums(queries[:, counted], places[:, counted], weights[counted], self.p)
        return np.asarray(sums ** (1 / self.p))


@dataclass
class Cityblock(VectorDistance):
    """City block distance, the sum of absolute differences (Payá et al., 2016, eq. 7 with p = 1).

    The rotation comes from the headings, where there are any.
    """

    def _distances(self, queries: Floats, places: Floats) -> Floats:
        from omnilab_appearance.common.kernels import power_sums

        return np.asarray(power_sums(queries, places, np.ones(places.shape[1], np.float32), 1))
