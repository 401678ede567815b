"""The conformance check of loop closures."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnilab import api
from omnilab.testing.common import check_common, expect


def check_loop_closure(closure: Any, frames: api.Frames) -> None:
    """Nodes are earlier ones, shapes agree, covariances are positive, two databases know nothing of each other; pickles."""
    closure = check_common("loop_closure", closure)
    found = []
    for database in (closure.begin(), closure.begin()):
        rng = np.random.default_rng(1)
        for i in range(len(frames)):
            closures = database.query(frames.at(i), None, 0.1, rng)
            count = len(closures.nodes)
            expect(i > 0 or count == 0, "the first image is recognised")
            expect(
                bool((closures.nodes < i).all()),
                f"image {i} is recognised as one that has not come before: {closures.nodes}",
            )
            expect(closures.motions.shape == (count, 3), f"motions have shape {closures.motions.shape}, not (K, 3)")
            expect(closures.covariances.shape == (count, 3, 3), f"covariances have shape {closures.covariances.shape}")
            expect(closures.distances.shape == (count,), f"distances have shape {closures.distances.shape}, not (K,)")
            expect(bool((np.linalg.eigvalsh(closures.covariances) > 0).all()), "covariances are not positive definite")
            found.append([*closures.nodes.tolist(), *closures.motions.ravel().tolist()])
    expect(found[: len(frames)] == found[len(frames) :], "a second database answers otherwise than the first")
