"""A distance of two boxes whose gradient does not jump: the exact one with a weak preference for the link's middle.

    D_soft = min_u  delta(y + R u) + kappa/2 |u|^2,   |u_j| <= h_j

u is a point of the link in its own frame, delta its distance from the obstacle. The exact distance (kappa = 0)
jumps from edge to edge of the link when two faces pass through parallel, and with it the torque on the hand;
here the point slides by tilt / kappa. The problem is strongly convex, so by the envelope theorem the
derivative of D_soft by the link's pose is that of delta with u fixed: the force stays an exact gradient.

delta is taken to the obstacle shrunk by a small margin beta: in L2 delta = |e| - beta, in L1 the sum of Huber
functions of width beta less beta/2, with e the excess of the point over the shrunk box. Both are the distance
itself over a face, and smooth down to contact.
"""

from __future__ import annotations

import numpy as np

from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix

KAPPA = 0.5
"""Preference for the middle of the link, 1/m: two degrees of tilt move the point by 70 mm, D by at most 2 mm."""
BETA = 5e-4
"""Margin by which the obstacle is shrunk, m."""
_GRADIENT_TOL = 1e-9
_STEPS = 40
WORK_SOFT = (12, 3)
"""Shape of the scratch array that `pair_soft` needs."""


@compiled
def _point_distance(euclidean: bool, x: Matrix, H: Matrix, g: Matrix, diagonal: Matrix) -> float:
    """Write gradient g and the Hessian's diagonal part of delta at a point x; return delta.

    In L2 the Hessian is (diag(diagonal) - g g^T) / |e| with diagonal in {0, 1}; in L1 it is diag(diagonal).
    """
    total = 0.0
    for k in range(3):
        core = H[k] - min(BETA, 0.5 * H[k])
        e = abs(x[k]) - core
        if e <= 0.0:
            g[k] = diagonal[k] = 0.0
            continue
        sign = 1.0 if x[k] > 0.0 else -1.0
        if euclidean:
            total += e * e
            g[k], diagonal[k] = sign * e, 1.0
        elif e < BETA:
            total += 0.5 * e * e / BETA
            g[k], diagonal[k] = sign * e / BETA, 1.0 / BETA
        else:
            total += e - 0.5 * BETA
            g[k], diagonal[k] = sign, 0.0
    if not euclidean:
        return total - 0.5 * BETA
    length = np.sqrt(total)
    if length > 0.0:
        for k in range(3):
            g[k] /= length
    return length - BETA


@compiled
def _objective(euclidean: bool, y: Matrix, R: Matrix, H: Matrix, u: Matrix, work: Matrix) -> float:
    """Return delta + kappa/2 |u|^2; rows of work: 0 point, 1 gradient of delta, 2 Hessian's diagonal."""
    for k in range(3):
        work[0, k] = y[k] + R[k, 0] * u[0] + R[k, 1] * u[1] + R[k, 2] * u[2]
    delta = _point_distance(euclidean, work[0], H, work[1], work[2])
    return delta + 0.5 * KAPPA * (u[0] ** 2 + u[1] ** 2 + u[2] ** 2)


@compiled
def _solve3(A: Matrix, b: Matrix, x: Matrix) -> None:
    """Write x = A^-1 b for a symmetric positive definite A (3, 3), by cofactors."""
    c0 = A[1, 1] * A[2, 2] - A[1, 2] * A[1, 2]
    c1 = A[0, 2] * A[1, 2] - A[0, 1] * A[2, 2]
    c2 = A[0, 1] * A[1, 2] - A[0, 2] * A[1, 1]
    scale = 1.0 / (A[0, 0] * c0 + A[0, 1] * c1 + A[0, 2] * c2)
    c3 = A[0, 0] * A[2, 2] - A[0, 2] * A[0, 2]
    c4 = A[0, 1] * A[0, 2] - A[0, 0] * A[1, 2]
    c5 = A[0, 0] * A[1, 1] - A[0, 1] * A[0, 1]
    x[0] = scale * (c0 * b[0] + c1 * b[1] + c2 * b[2])
    x[1] = scale * (c1 * b[0] + c3 * b[1] + c4 * b[2])
    x[2] = scale * (c2 * b[0] + c4 * b[1] + c5 * b[2])


@compiled
def _bounded(u: float, h: float) -> float:
    """Return u within its bounds, on a bound when next to it: a hair's breadth of room would stop every step."""
    if abs(u) > (1.0 - 1e-6) * h:
        return h if u > 0.0 else -h
    return u


@compiled
def _hold(i: int, hess: Matrix, slope: Matrix) -> None:
    """Take coordinate i out of the Newton system."""
    for j in range(3):
        hess[i, j] = hess[j, i] = 0.0
    hess[i, i], slope[i] = 1.0, 0.0


@compiled
def _newton_step(euclidean: bool, R: Matrix, h: Matrix, H: Matrix, u: Matrix, work: Matrix) -> float:
    """Write the step (row 4) on the coordinates not held at a bound; return the largest free gradient."""
    g, diagonal, slope, step, hess, rg = work[1], work[2], work[3], work[4], work[5:8], work[8]
    length = 0.0
    for k in range(3):
        e = max(0.0, abs(work[0, k]) - H[k] + min(BETA, 0.5 * H[k]))
        length += e * e
    length = np.sqrt(length)
    largest = 0.0
    for j in range(3):
        rg[j] = R[0, j] * g[0] + R[1, j] * g[1] + R[2, j] * g[2]
        slope[j] = rg[j] + KAPPA * u[j]
    for i in range(3):
        for j in range(3):
            value = 0.0
            for k in range(3):
                value += R[k, i] * diagonal[k] * R[k, j]
            if euclidean:
                value = (value - rg[i] * rg[j]) / length if length > 0.0 else 0.0
            hess[i, j] = value
        hess[i, i] += KAPPA
    for i in range(3):
        if (u[i] >= h[i] and slope[i] < 0.0) or (u[i] <= -h[i] and slope[i] > 0.0):
            _hold(i, hess, slope)
        largest = max(largest, abs(slope[i]))
    for _ in range(3):
        _solve3(hess, slope, step)
        inside = True
        for i in range(3):
            # A bound may be left only inward: what the coupling pushes out is held, so the step stays a descent.
            if (u[i] >= h[i] and step[i] < 0.0) or (u[i] <= -h[i] and step[i] > 0.0):
                _hold(i, hess, slope)
                inside = False
        if inside:
            break
    return largest


@compiled
def pair_soft(euclidean: bool, y: Matrix, R: Matrix, h: Matrix, H: Matrix, a: Matrix, d: Matrix, work: Matrix) -> float:
    """Return D_soft (m), started at the exact witness a (3,) in the obstacle's frame; write its own a and gradient d.

    Arguments as in `pair_l2`; `work` has shape `WORK_SOFT`. |d| = 1 in L2 and at most 1 an axis in L1.
    Meant for boxes that do not overlap. Solved by projected Newton steps, halved until the objective falls.
    """
    u, trial = work[9], work[10]
    for j in range(3):
        along = R[0, j] * (a[0] - y[0]) + R[1, j] * (a[1] - y[1]) + R[2, j] * (a[2] - y[2])
        u[j] = _bounded(along, h[j])
    value = _objective(euclidean, y, R, H, u, work)
    for _ in range(_STEPS):
        if _newton_step(euclidean, R, h, H, u, work) < _GRADIENT_TOL:
            break
        scale, fell, lower = 1.0, False, value
        while scale > 1e-7 and not fell:
            for j in range(3):
                trial[j] = _bounded(u[j] - scale * work[4, j], h[j])
            lower = _objective(euclidean, y, R, H, trial, work)
            fell = lower < value - 1e-16
            scale *= 0.5
        if not fell:
            value = _objective(euclidean, y, R, H, u, work)
            break
        value = lower
        u[0], u[1], u[2] = trial[0], trial[1], trial[2]
    for k in range(3):
        a[k], d[k] = work[0, k], work[1, k]
    return value
