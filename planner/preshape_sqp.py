"""Repeated steps of eq. (5): quadratic programs on eq. (4) linearised anew at every iterate, in one compiled loop.

In the scaled displacement z = W d the problem is  min 1/2 |z|^2  s.t.  c(z) = 0,  lower <= z <= upper, with
c = eq. (4) over a length. The step s minimises 1/2 |z + s|^2 + 1/2 s'H s + |A s + c + rho y|^2 / (2 rho), which is
eq. (5) with a slack rho (y+ - y) that dies out as the multipliers y converge. H = sum_i y_i d2c_i/dz2 is left
out (Gauss-Newton) far from the goal and raised until the program is convex near it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix
from preshape.planner.bounded_qp import solve_bounded_qp
from preshape.planner.hand_kinematics import HandTables
from preshape.planner.preshape_constraint import Nominal, constraint_curvature, tip_constraint
from preshape.planner.small_matrix import mat_vec

RHO = 1e-6
"""Softness of the linearised constraint in a step (dimensionless)."""

CURVATURE_LIMIT = 300.0
"""Multipliers above this belong to an infeasible linearisation: their curvature says nothing."""

MERIT_LIMIT = 100.0
"""Largest weight of eq. (4) in the merit."""

SHIFTS = 14
"""Attempts to make a program convex; the last adds 80 times the cost's own curvature."""


class Limits(NamedTuple):
    """Weights W (19,), bounds on d (19,), the length (m) that scales eq. (4), first trust radius, when to stop."""

    weights: Matrix
    lower: Matrix
    upper: Matrix
    length: float
    radius: float
    iterations: int
    tolerance: float


class Outcome(NamedTuple):
    """Iterations used, worst fingertip error (m), scaled KKT residual and objective 1/2 |W d|^2 at the last iterate."""

    iterations: int
    residual: float
    kkt: float
    cost: float


@compiled
def kkt_residual(z: Matrix, A: Matrix, y: Matrix, lower: Matrix, upper: Matrix) -> float:
    """Return max_i |z - clip(z - grad L, lower, upper)|_i / max(1, |z|, |A'y|), the stationarity of eq. (5).

    grad L = z + A'y in scaled coordinates; a component at a bound counts only when the gradient points inwards.
    """
    worst, scale = 0.0, 1.0
    for i in range(z.shape[0]):
        s = 0.0
        for k in range(y.shape[0]):
            s += A[k, i] * y[k]
        moved = min(max(-s, lower[i]), upper[i])
        worst = max(worst, abs(z[i] - moved))
        scale = max(scale, abs(z[i]), abs(s))
    return worst / scale


@compiled
def _worst_tip(c: Matrix) -> float:
    worst = 0.0
    for n in range(c.shape[0] // 3):
        worst = max(worst, np.sqrt(c[3 * n] ** 2 + c[3 * n + 1] ** 2 + c[3 * n + 2] ** 2))
    return worst


@compiled
def quadratic_step(
    z: Matrix, c: Matrix, A: Matrix, y: Matrix, H: Matrix, lower: Matrix, upper: Matrix, radius: float, s: Matrix
) -> bool:
    """Write the step s (19,) of the module's quadratic program; no component longer than `radius`.

    With z = 0, y = 0 and H = 0 this is eq. (5) (with a slack of RHO). Where the program is not convex, multiples
    of |s|^2 are added until it is; False when that does not help.
    """
    n, m = z.shape[0], c.shape[0]
    s_lower, s_upper = np.maximum(lower - z, -radius), np.minimum(upper - z, radius)
    base, g = H + np.eye(n), z.copy()
    for k in range(m):
        b = c[k] / RHO + y[k]
        for i in range(n):
            g[i] += A[k, i] * b
            for j in range(n):
                base[i, j] += A[k, i] * A[k, j] / RHO
    shift = 0.0
    for _ in range(SHIFTS):
        s[:] = 0.0
        if solve_bounded_qp(base + np.eye(n) * shift, g, s_lower, s_upper, s) >= 0:
            return True
        shift = max(0.02, 2.0 * shift)
    return False


@compiled
def _scaled_curvature(
    tables: HandTables,
    nominal: Nominal,
    limits: Limits,
    z: Matrix,
    frames: Matrix,
    origins: Matrix,
    tips: Matrix,
    J: Matrix,
    y: Matrix,
    H: Matrix,
) -> None:
    """Write sum_i y_i d2c_i/dz2, or zero where the multipliers say nothing."""
    H[:] = 0.0
    if 0.0 < np.abs(y).max() < CURVATURE_LIMIT:
        constraint_curvature(tables, nominal, z / limits.weights, frames, origins, tips, J, y / limits.length, H)
        for i in range(H.shape[0]):
            for j in range(H.shape[0]):
                H[i, j] /= limits.weights[i] * limits.weights[j]


@compiled
def _merit(z: Matrix, c: Matrix, nu: float) -> float:
    return 0.5 * np.sum(z * z) + nu * np.sum(np.abs(c))


@compiled
def descend(tables: HandTables, nominal: Nominal, limits: Limits, d: Matrix, y: Matrix) -> Outcome:
    """Take steps from d (19,) until fingertips and KKT residual are within tolerance; d and y (3 n,) are overwritten.

    A step is halved until the merit 1/2 |z|^2 + nu |c|_1 falls; the trust radius follows. A start whose residual
    no longer shrinks is given up early.
    """
    W, length, m = limits.weights, limits.length, y.shape[0]
    lower, upper = W * limits.lower, W * limits.upper
    z = np.minimum(np.maximum(W * d, lower), upper)
    frames, origins, tips, J = np.empty((18, 3, 3)), np.empty((18, 3)), np.empty((4, 3)), np.empty((4, 3, 13))
    c, A, H, s = np.empty(m), np.empty((m, 19)), np.zeros((19, 19)), np.zeros(19)
    tip_constraint(tables, nominal, z / W, frames, origins, tips, J, c, A)
    c /= length
    A[:] = A / length / W
    radius, nu, best, patience = limits.radius, 1.0, np.inf, 0
    residual, kkt, count = _worst_tip(c) * length, np.inf, 0
    for iteration in range(limits.iterations):
        _scaled_curvature(tables, nominal, limits, z, frames, origins, tips, J, y, H)
        if not quadratic_step(z, c, A, y, H, lower, upper, radius, s):
            break
        y_new = y + (mat_vec(A, s) + c) / RHO
        nu = min(max(nu, 1.5 * np.abs(y_new).max()), MERIT_LIMIT)
        merit, z_old, t = _merit(z, c, nu), z, 1.0
        for _ in range(5):
            z = np.minimum(np.maximum(z_old + t * s, lower), upper)
            tip_constraint(tables, nominal, z / W, frames, origins, tips, J, c, A)
            c /= length
            if _merit(z, c, nu) <= merit or np.abs(s).max() < 1e-3:
                break
            t *= 0.5
        A[:] = A / length / W
        y[:] += t * (y_new - y)
        radius = min(1.6 * radius, 2.0) if t == 1.0 else max(0.5 * radius, 0.05)
        residual, kkt, count = _worst_tip(c) * length, kkt_residual(z, A, y, lower, upper), iteration + 1
        if residual < limits.tolerance and kkt < limits.tolerance:
            break
        patience = 0 if residual < 0.8 * best else patience + 1
        best = min(best, residual)
        if patience > 6 and residual > 1e-3:
            break
    d[:] = np.minimum(np.maximum(z / W, limits.lower), limits.upper)
    return Outcome(count, residual, kkt, 0.5 * np.sum(z * z))
