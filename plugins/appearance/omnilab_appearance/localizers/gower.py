"""Local maps that a query is added to: its distances may all be too large by the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnilab.api import Floats, Ints
from omnilab_appearance.localizers.smacof import Smacof


@dataclass
class Gower(Smacof):
    """A local map of least stress of the places alone, to which the query is added by trilateration (Gower, 1968).

    What hides part of a query makes it less alike to every place: its squared distances grow by a constant, as the
    change of its signature is orthogonal to what tells places apart, and a map that takes them as they are pushes it
    out of its places. The differences of squared distances, d_i² - d_j² = |x_i - q|² - |x_j - q|², keep its position:
    least squares over all places, in which the constant cancels. The last point of a map is the query; distances of it
    that do not count are left out, and `constants` weigh the others.
    """

    def _embed(
        self, lengths: Floats, weights: Floats, rng: np.random.Generator, steps: int
    ) -> tuple[Floats, Ints, Floats | None]:
        """The map of all points but the last, and the last added to it."""
        places, iterations, states = super()._embed(
            np.ascontiguousarray(lengths[:, :-1, :-1]), np.ascontiguousarray(weights[:, :-1, :-1]), rng, steps
        )
        square, weight = lengths[:, -1, :-1] ** 2, weights[:, -1, :-1]
        if states is not None:
            states = np.stack([with_added(state, square, weight) for state in states])
        return with_added(places, square, weight), iterations, states


def with_added(places: Floats, square: Floats, weight: Floats) -> Floats:
    """Maps (B, n + 1, 2): the n places (B, n, 2), and a point of squared distances (B, n) to them, up to a constant.

    Weights (B, n). Of places on one line it lies on that line; without any weight it is in their middle.
    """
    known = weight.sum(axis=1, keepdims=True) > 0
    share = np.where(known, weight, 1.0)
    share = (share / share.sum(axis=1, keepdims=True))[..., None]
    middle = (share * places).sum(axis=1, keepdims=True)
    centred = places - middle
    excess = (centred**2).sum(axis=2, keepdims=True) - square[..., None]
    excess -= (share * excess).sum(axis=1, keepdims=True)
    # |x_i|² - d_i² = 2 x_i q + a constant, which centred x_i are orthogonal to
    root = np.sqrt(share)
    point = 0.5 * np.linalg.pinv(root * centred) @ (root * excess)
    return np.concatenate([places, middle + np.where(known[..., None], point.swapaxes(1, 2), 0)], axis=1)
