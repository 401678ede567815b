"""How long a step was, from two images and the direction of motion."""

from __future__ import annotations

import numpy as np

from omnilab.api import Floats, Signatures
from omnilab_appearance.poc import Poc

LOW = 0.2  # sine of the depression below the horizon from which floor is looked for
PLACED_RAD = np.deg2rad(0.1)  # standard deviation of a feature's direction
FLOOR = 12  # matches on the floor, at least
NEARLY = 0.7  # of the votes of the most popular step, for a shorter one to be preferred
CANDIDATES = 200  # lengths that are tried


def floor_length(p: Floats, q: Floats, beta_rad: float) -> tuple[float, float, str]:
    """The step in heights of the camera above the floor, its standard deviation, and why it cannot be told.

    Unit directions (M, 3) before and after, in parallel axes. A point of the floor in direction p is seen at p_xy / -p_z
    heights from the camera's foot; between the two images it moved by the step, against the direction of motion. What
    stands above the floor seems to move further: the step is the mode of what the matches tell, each with its own
    deviation, or a shorter one that nearly as many agree on.
    """
    low = (p[:, 2] < -LOW) & (q[:, 2] < -LOW)
    p, q = p[low], q[low]
    moved = p[:, :2] / -p[:, 2:] - q[:, :2] / -q[:, 2:]
    c, s = np.cos(beta_rad), np.sin(beta_rad)
    step, aside = moved @ [c, s], moved @ [-s, c]
    sigma = np.sqrt(2) * PLACED_RAD / p[:, 2] ** 2
    straight = (np.abs(aside) < 3 * sigma) & (step > -3 * sigma)
    step, sigma = step[straight], sigma[straight]
    if len(step) < FLOOR:
        return np.nan, np.nan, f"{len(step)} matches lie on the floor"
    tried = np.quantile(step, np.linspace(0, 1, CANDIDATES))
    votes = np.exp(-0.5 * ((step - tried[:, None]) / sigma) ** 2).sum(axis=1)
    peaks = (votes >= np.append(votes[1:], 0)) & (votes >= np.append(0, votes[:-1])) & (votes >= NEARLY * votes.max())
    length = float(tried[peaks.argmax()])
    for _ in range(8):
        weight = 1 / (sigma * (1 + ((step - length) / (2 * sigma)) ** 2)) ** 2
        length = float((weight * step).sum() / weight.sum())
    near = np.abs(step - length) < 3 * sigma
    if near.sum() < FLOOR:
        return np.nan, np.nan, f"{near.sum()} matches agree on the floor"
    fit = max(1.0, float(np.sqrt(np.mean(((step - length) / sigma)[near] ** 2))))
    return length, fit / float(np.sqrt((1 / sigma[near] ** 2).sum())), ""


def poc_length(before: Floats, now: Floats) -> float:
    """The distance of two Radon transforms (1, N, M) by phase-only correlation (Berenguer, thesis, eq. 6.4, 6.5)."""
    poc = Poc()
    return float(poc.match(Signatures(now), poc.prepare(Signatures(before))).distance[0, 0])
