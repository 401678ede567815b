"""Numba kernels of `spring` and `smacof`. Every set of points is embedded alone, in one fixed order.

Points are (2, n), and every pair is visited from both sides: that is what the compiler turns into vector code. Parallel loops
only call, and points are copied by a loop: assigning an array to a part of one takes three seconds to compile.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from omnilab.api import Floats, Ints

SMALLEST = 1e-4  # share of the time step below which no smaller one is tried
RELEASED = 2.0  # a system whose energy grows to this many times that of its start diverges
# sums may be split into vectors; NaN and infinity stay what they are
ANY_ORDER = {"reassoc", "contract", "arcp", "nsz"}
TINY = 1e-300  # keeps the direction between two points in one place at zero


def springs(
    lengths: Floats, stiffness: Floats, damping: Floats, start: Floats, verlet: bool, step_s: float, tolerance: float,
    limit: int, marks: Ints,
) -> tuple[Floats, Floats, Ints, Floats, Floats]:  # fmt: skip
    """Integrate masses of 1 kg from rest at `start` (R, 2, n), joined by springs and dampers: three times (B, n, n).

    The first R / B starts are of the first set, and so on. Answers positions (R, 2, n), energies (R,), iterations (R,),
    -1 where they did not settle in `limit`, time steps (R,), halved where the system diverged, and the states
    (M, R, 2, n) after as many iterations as `marks` (M, R) say.
    """
    count = len(start)
    out = (start.copy(), np.empty(count), np.empty(count, np.int64), np.full(count, step_s))
    states = np.empty((len(marks), *start.shape))
    _all_springs(lengths, stiffness, damping, start, verlet, tolerance, limit, marks, *out, states)
    return *out, states


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def _all_springs(  # type: ignore[no-untyped-def]
    lengths, stiffness, damping, start, verlet, tolerance, limit, marks, position, energy, iterations, steps, states
):
    starts = len(start) // len(lengths)
    for r in nb.prange(len(start)):
        b = r // starts
        energy[r], iterations[r], steps[r] = _settle_at_some_step(
            start[r], position[r], lengths[b], stiffness[b], damping[b], verlet, steps[r], tolerance, limit,
            marks[:, r], states[:, r],
        )  # fmt: skip


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _settle_at_some_step(  # type: ignore[no-untyped-def]
    start, p, lengths, stiffness, damping, verlet, step, tolerance, limit, marks, states
):
    """Integrate one system in place, in half the time step as often as it diverges: its energy, iterations, and step."""
    first, diverged, energy, iterations = step, True, 0.0, -1
    while diverged and step > SMALLEST * first:
        _copy(start, p)
        energy, iterations, diverged = _settle(
            p, lengths, stiffness, damping, verlet, step, tolerance, limit, marks, states
        )
        if diverged:
            step /= 2
    return energy, iterations, step


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _settle(p, lengths, stiffness, damping, verlet, step, tolerance, limit, marks, states):  # type: ignore[no-untyped-def]
    """Integrate one system in place until its springs keep their lengths: its energy, iterations, and whether it diverged.

    A rotation of the whole does not count: dampers along the springs do not damp it, and eq. 4 excites it.
    """
    velocity, force, before = np.zeros_like(p), np.empty_like(p), np.empty_like(p)
    stiffest, dampers = 0.0, 0.0
    for i in range(p.shape[1]):
        for j in range(p.shape[1]):
            stiffest = max(stiffest, stiffness[i, j])
            dampers += damping[i, j]
    slowest = tolerance * min(1.0, stiffest)  # springs far softer than their dampers creep
    least_power = slowest * slowest * dampers
    energy, power = _forces(p, velocity, lengths, stiffness, damping, force)
    released = RELEASED * energy
    for iteration in range(limit + 1):
        for m in range(len(marks)):
            if marks[m] == iteration:
                _copy(p, states[m])
        if iteration > 0:
            energy, power = _forces(p, velocity, lengths, stiffness, damping, force)
            if not energy + 0.5 * _squared(velocity) <= released:  # NaN counts as diverged
                return energy, -1, True
            if power <= least_power:
                return energy, iteration, False
        for axis in range(2):
            for i in range(p.shape[1]):
                here, push = p[axis, i], force[axis, i]
                if not verlet:  # eq. 4
                    p[axis, i] += velocity[axis, i] * step
                    velocity[axis, i] += push * step
                elif iteration == 0:  # eq. 5, from rest
                    p[axis, i] += 0.5 * push * step * step
                    velocity[axis, i] = push * step
                else:  # eq. 6
                    p[axis, i] = 2 * here - before[axis, i] + push * step * step
                    velocity[axis, i] = (p[axis, i] - before[axis, i]) / (2 * step)
                before[axis, i] = here
    return energy, -1, False


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=ANY_ORDER)
def _forces(p, velocity, lengths, stiffness, damping, force):  # type: ignore[no-untyped-def]
    """Write the forces (2, n) of springs, and of dampers along them; answer the springs' energy and the dampers' power."""
    energy, power = 0.0, 0.0
    for i in range(p.shape[1]):
        fx, fy = 0.0, 0.0
        for j in range(p.shape[1]):
            dx, dy = p[0, i] - p[0, j], p[1, i] - p[1, j]
            square = dx * dx + dy * dy
            inverse = 1 / math.sqrt(square + TINY)
            dx *= inverse
            dy *= inverse
            stretch = square * inverse - lengths[i, j]
            parting = (velocity[0, i] - velocity[0, j]) * dx + (velocity[1, i] - velocity[1, j]) * dy
            energy += stiffness[i, j] * stretch * stretch
            power += damping[i, j] * parting * parting
            pull = stiffness[i, j] * stretch + damping[i, j] * parting
            fx -= pull * dx
            fy -= pull * dy
        force[0, i] = fx
        force[1, i] = fy
    return 0.25 * energy, power


def majorise(
    lengths: Floats, weights: Floats, inverse: Floats, start: Floats, tolerance: float, limit: int, marks: Ints
) -> tuple[Floats, Ints, Floats]:
    """Lower the stress of points `start` (B, 2, n) by Guttman transforms; `inverse` (B, n, n) is of the weights' Laplacian.

    Answers positions (B, 2, n), iterations (B,), -1 where the stress still fell after `limit`, and the states
    (M, B, 2, n) after as many iterations as `marks` (M, B) say.
    """
    position, iterations = start.copy(), np.empty(len(start), np.int64)
    states = np.empty((len(marks), *start.shape))
    _majorise_all(lengths, weights, inverse, tolerance, limit, marks, position, iterations, states)
    return position, iterations, states


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def _majorise_all(lengths, weights, inverse, tolerance, limit, marks, position, iterations, states):  # type: ignore[no-untyped-def]
    for b in nb.prange(len(position)):
        iterations[b] = _majorise_one(
            position[b], lengths[b], weights[b], inverse[b], tolerance, limit, marks[:, b], states[:, b]
        )


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _majorise_one(x, lengths, weights, inverse, tolerance, limit, marks, states):  # type: ignore[no-untyped-def]
    """Lower the stress of points (2, n) in place; answer the iterations."""
    pulled = np.empty_like(x)
    nothing = 0.0
    for i in range(x.shape[1]):
        for j in range(x.shape[1]):
            nothing += weights[i, j] * lengths[i, j] * lengths[i, j]
    nothing *= 1e-28
    best = np.inf
    for iteration in range(limit + 1):
        for m in range(len(marks)):
            if marks[m] == iteration:
                _copy(x, states[m])
        stress = _pull(x, lengths, weights, pulled)
        if stress >= (1 - tolerance) * best or stress <= nothing:
            return iteration
        best = stress
        _product(pulled, inverse, x)
    return -1


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=ANY_ORDER)
def _pull(x, lengths, weights, pulled):  # type: ignore[no-untyped-def]
    """Write B(X) X (2, n); answer the stress, every pair counted twice."""
    stress = 0.0
    for i in range(x.shape[1]):
        px, py = 0.0, 0.0
        for j in range(x.shape[1]):
            dx, dy = x[0, i] - x[0, j], x[1, i] - x[1, j]
            square = dx * dx + dy * dy
            inverse = 1 / math.sqrt(square + TINY)
            misfit = square * inverse - lengths[i, j]
            stress += weights[i, j] * misfit * misfit
            pull = weights[i, j] * lengths[i, j] * inverse
            px += pull * dx
            py += pull * dy
        pulled[0, i] = px
        pulled[1, i] = py
    return stress


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=ANY_ORDER)
def _product(points, matrix, out):  # type: ignore[no-untyped-def]
    """Write points (2, n) times a symmetric matrix (n, n)."""
    for i in range(points.shape[1]):
        px, py = 0.0, 0.0
        for j in range(points.shape[1]):
            px += matrix[i, j] * points[0, j]
            py += matrix[i, j] * points[1, j]
        out[0, i] = px
        out[1, i] = py


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _copy(points, out):  # type: ignore[no-untyped-def]
    for axis in range(2):
        for i in range(points.shape[1]):
            out[axis, i] = points[axis, i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _squared(vectors):  # type: ignore[no-untyped-def]
    total = 0.0
    for axis in range(2):
        for i in range(vectors.shape[1]):
            total += vectors[axis, i] * vectors[axis, i]
    return total
