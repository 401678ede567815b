"""Root distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats
from omnilab_appearance.distances.vector_distance import VectorDistance


@dataclass
class Root(VectorDistance):
    """sqrt(mean_i ((r_i - s_i) / (r_i + s_i))^2) (Payá et al., 2016, eq. 13).

    Made for signatures without negative components, where it lies in [0, 1]; a term with r_i + s_i = 0 counts nothing.
    The rotation comes from the headings, where there are any.
    """

    def _distances(self, queries: Floats, places: Floats) -> Floats:
        from omnilab_appearance.common.kernels import contrast_sums

        return np.asarray(np.sqrt(contrast_sums(queries, places) / places.shape[1]))
