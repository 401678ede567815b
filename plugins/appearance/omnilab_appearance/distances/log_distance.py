"""Log distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats
from omnilab_appearance.distances.vector_distance import VectorDistance

FARTHEST = 1 - 1e-6  # where differences as large as the map's range would make the distance infinite


@dataclass
class Log(VectorDistance):
    """-log10(1 - mean_i |r_i - s_i| / range_i), range_i over the whole map (Payá et al., 2016, eq. 12).

    Components that are constant over the map are left out. A query far outside of the map's range
    is at distance 6. The rotation comes from the headings, where there are any.
    """

    def _fit(self, places: Floats) -> tuple[Floats, Floats]:
        """The places and the weight (D,) of each component."""
        span = np.ptp(places, axis=0)
        varies = span > 0
        weights = np.divide(1.0, span, out=np.zeros_like(span), where=varies) / max(1, varies.sum())
        return places, weights.astype(np.float32)

    def _distances(self, queries: Floats, places: tuple[Floats, Floats]) -> Floats:
        from omnilab_appearance.common.kernels import power_sums

        return np.asarray(-np.log10(1 - np.minimum(power_sums(queries, *places, 1), FARTHEST)))
