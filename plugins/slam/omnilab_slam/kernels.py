"""Robust kernels (M-estimators): the weight of a loop closure by how well it fits."""

from __future__ import annotations

from enum import Enum
from typing import Any

import numpy as np

from omnilab.api import Floats


class Kernel(Enum):
    """Robust kernels, by how fast their weight falls: the last four are redescending, and so need a start that is near."""

    none = "none"
    huber = "huber"
    cauchy = "cauchy"
    geman_mcclure = "geman_mcclure"
    welsch = "welsch"
    tukey = "tukey"
    dcs = "dcs"


NAMES = {
    Kernel.huber: ("Huber", 1.345),
    Kernel.cauchy: ("Cauchy", 2.385),
    Kernel.geman_mcclure: ("GemanMcClure", 3.0),
    Kernel.welsch: ("Welsch", 2.985),
    Kernel.tukey: ("Tukey", 4.685),
    Kernel.dcs: ("DCS", 3.0),
}  # and the width in standard deviations: 95 % efficiency (Zhang, 1997) where that is known
REDESCENDING = {Kernel.geman_mcclure, Kernel.welsch, Kernel.tukey, Kernel.dcs}


def estimator(kernel: Kernel, width: float | None) -> Any:
    """GTSAM's M-estimator of a kernel."""
    import gtsam

    name, usual = NAMES[kernel]
    return getattr(gtsam.noiseModel.mEstimator, name).Create(usual if width is None else width)


def weights(kernel: Kernel, width: float | None, loops: Any, edge_chi2: Floats) -> Floats:
    """Weights (E,) in [0, 1] of the edges by their chi2 (E,); only those of loop closures, `loops` (E,), can be below 1."""
    weight = np.ones(len(edge_chi2))
    if kernel is not Kernel.none:
        weight_of = estimator(kernel, width).weight
        weight[loops] = [weight_of(float(distance)) for distance in np.sqrt(edge_chi2[loops])]
    return np.clip(weight, 0, 1)


def costs(kernel: Kernel, width: float | None, loops: Any, edge_chi2: Floats) -> Floats:
    """What each edge (E,) adds to the robust cost: its chi2, a loop closure's as far as the kernel counts it."""
    cost = edge_chi2.copy()
    if kernel is not Kernel.none:
        loss_of = estimator(kernel, width).loss
        cost[loops] = [2 * loss_of(float(distance)) for distance in np.sqrt(edge_chi2[loops])]
    return cost


def why(kernel: Kernel) -> str | None:
    """When a loop closure is rejected, in a few words; None: never."""
    return None if kernel is Kernel.none else f"kernel {kernel.value} counts them less than half"
