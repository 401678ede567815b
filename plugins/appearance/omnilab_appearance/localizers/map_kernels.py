"""Numba kernels of `spring` and `smacof`. Every set of points is embedded alone, in one fixed order.

Points are (2, n), and every pair is visited from both sides: that is what the compiler turns into vector code.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

SMALLEST = 1e-4  # share of the time step below which no smaller one is tried
RELEASED = 2.0  # a system whose energy grows to this many times that of its start diverges
# sums may be split into vectors; NaN and infinity stay what they are
ANY_ORDER = {"reassoc", "contract", "arcp", "nsz"}
TINY = 1e-300  # keeps the direction between two points in one place at zero


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def springs(lengths, stiffness, damping, start, verlet, step_s, tolerance, limit, marks):  # type: ignore[no-untyped-def]
    """Integrate masses of 1 kg from rest at `start` (R, 2, n), joined by springs and dampers: three times (B, n, n).

    The first R / B starts are of the first set, and so on. Answers positions (R, 2, n), energies (R,), iterations (R,),
    -1 where they did not settle in `limit`, time steps (R,), halved where the system diverged, and the states
    (M, R, 2, n) after as many iterations as `marks` (M, R) say.
    """
    starts = len(start) // len(lengths)
    position = start.copy()
    energy = np.empty(len(start))
    iterations = np.empty(len(start), np.int64)
    steps = np.full(len(start), step_s)
    states = np.empty((len(marks), *start.shape))
    for r in nb.prange(len(start)):
        b, diverged = r // starts, True
        while diverged and steps[r] > SMALLEST * step_s:
            position[r] = start[r]
            energy[r], iterations[r], diverged = _settle(
                position[r], lengths[b], stiffness[b], damping[b], verlet, steps[r], tolerance, limit, marks[:, r],
                states[:, r],
            )  # fmt: skip
            if diverged:
                steps[r] /= 2
    return position, energy, iterations, steps, states


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _settle(p, lengths, stiffness, damping, verlet, step, tolerance, limit, marks, states):  # type: ignore[no-untyped-def]
    """Integrate one system in place until its springs keep their lengths: its energy, iterations, and whether it diverged.

    A rotation of the whole does not count: dampers along the springs do not damp it, and eq. 4 excites it.
    """
    velocity, force, before = np.zeros_like(p), np.empty_like(p), np.empty_like(p)
    slowest = tolerance * min(1.0, np.max(stiffness))  # springs far softer than their dampers creep
    least_power = slowest * slowest * np.sum(damping)
    energy, power = _forces(p, velocity, lengths, stiffness, damping, force)
    released = RELEASED * energy
    for iteration in range(limit + 1):
        for m in range(len(marks)):
            if marks[m] == iteration:
                states[m] = p
        if iteration > 0:
            energy, power = _forces(p, velocity, lengths, stiffness, damping, force)
            if not energy + 0.5 * np.sum(velocity * velocity) <= released:  # NaN counts as diverged
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


@nb.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def majorise(lengths, weights, inverse, start, tolerance, limit, marks):  # type: ignore[no-untyped-def]
    """Lower the stress of points `start` (B, 2, n) by Guttman transforms; `inverse` (B, n, n) is of the weights' Laplacian.

    Answers positions (B, 2, n), iterations (B,), -1 where the stress still fell after `limit`, and the states
    (M, B, 2, n) after as many iterations as `marks` (M, B) say.
    """
    position = start.copy()
    iterations = np.full(len(start), -1, np.int64)
    states = np.empty((len(marks), *start.shape))
    for b in nb.prange(len(start)):
        x, pulled = position[b], np.empty_like(start[b])
        nothing = 1e-28 * np.sum(weights[b] * lengths[b] * lengths[b])
        best = np.inf
        for iteration in range(limit + 1):
            for m in range(len(marks)):
                if marks[m, b] == iteration:
                    states[m, b] = x
            stress = _pull(x, lengths[b], weights[b], pulled)
            if stress >= (1 - tolerance) * best or stress <= nothing:
                iterations[b] = iteration
                break
            best = stress
            _product(pulled, inverse[b], x)
    return position, iterations, states


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
