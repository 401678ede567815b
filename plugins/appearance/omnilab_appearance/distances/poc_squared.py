"""Squared phase-only correlation distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Match, Signatures
from omnilab_appearance.distances.poc import Poc, PocIndex


@dataclass
class PocSquared(Poc):
    """Phase-only correlation, squared: (1 - max C)^2 (Berenguer, thesis, eq. 4.4).

    The order of the places is that of `poc`, and so are the rotations; the distance is more linear in metres (figure 4.5).
    """

    def match(self, queries: Signatures, index: PocIndex) -> Match:
        """Distances and rotations (Q, P)."""
        match = super().match(queries, index)
        return Match(np.square(match.distance), match.rotation_rad)
