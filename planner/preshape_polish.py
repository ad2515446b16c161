"""The last digits of a preshape: Newton steps on the optimality conditions of eq. (5), with the bounds that hold fixed.

For starts that creep: near a flat or unstable point of the cost, or where the fingertips only just (or not quite)
reach. There the slack stays, |c| <= rho |y|, and is reported as the residual.
"""

from __future__ import annotations

import numpy as np

from preshape.hal.layout import HAND_DOF
from preshape.hal.transform import Matrix
from preshape.planner.hand_kinematics import PART_COUNT, HandTables
from preshape.planner.preshape_constraint import STATE_DOF, Nominal, constraint_curvature, tip_constraint
from preshape.planner.preshape_sqp import Limits, Outcome, kkt_residual

STEPS = 12
"""Newton steps at most."""

AT_BOUND = 1e-9
"""A component this close to a bound lies on it (scaled)."""


def _least_squares(A: Matrix, b: Matrix) -> Matrix:
    return np.asarray(np.linalg.lstsq(A, b, rcond=1e-13)[0], dtype=np.float64)


class _Point:
    """Constraint, Jacobian and multipliers at one scaled displacement z."""

    def __init__(self, tables: HandTables, nominal: Nominal, limits: Limits, z: Matrix) -> None:
        n = nominal.targets.size
        work = np.empty((PART_COUNT, 3, 3)), np.empty((PART_COUNT, 3)), np.empty((4, 3)), np.empty((4, 3, HAND_DOF))
        c, A = np.empty(n), np.empty((n, STATE_DOF))
        tip_constraint(tables, nominal, z / limits.weights, *work, c, A)
        self.tables, self.nominal, self.limits, self.work, self.z = tables, nominal, limits, work, z
        self.c, self.A = c / limits.length, A / limits.length / limits.weights
        self.lower, self.upper = limits.weights * limits.lower, limits.weights * limits.upper
        self.free = np.ones(STATE_DOF, bool)
        self.y: Matrix = np.zeros(n)
        for _ in range(4):
            self.y = _least_squares(self.A[:, self.free].T, -self.z[self.free])
            gradient = self.z + self.A.T @ self.y
            free = ~(((z <= self.lower + AT_BOUND) & (gradient > 0)) | ((z >= self.upper - AT_BOUND) & (gradient < 0)))
            if np.array_equal(free, self.free):
                break
            self.free = free

    def outcome(self, count: int) -> Outcome:
        """Return residual and KKT residual here."""
        residual = float(np.linalg.norm(self.c.reshape(-1, 3), axis=1).max()) * self.limits.length
        kkt = kkt_residual(self.z, self.A, self.y, self.lower, self.upper)
        return Outcome(count, residual, kkt, float(0.5 * self.z @ self.z))

    def step(self, rho: float) -> Matrix:
        """Return the Newton step of z: [1 + H, A'; A, -rho] [s; y+] = [-z; -c] on the free components."""
        W, f = self.limits.weights, np.flatnonzero(self.free)
        H, m = np.empty((STATE_DOF, STATE_DOF)), len(self.c)
        constraint_curvature(self.tables, self.nominal, self.z / W, *self.work, self.y / self.limits.length, H)
        G = np.eye(STATE_DOF) + H / W[:, None] / W
        K = np.block([[G[np.ix_(f, f)], self.A[:, f].T], [self.A[:, f], -rho * np.eye(m)]])
        s = np.zeros(STATE_DOF)
        s[f] = _least_squares(K, -np.concatenate([self.z[f], self.c]))[: len(f)]
        return np.clip(self.z + s, self.lower, self.upper) - self.z


def polish(tables: HandTables, nominal: Nominal, limits: Limits, d: Matrix, rho: float) -> tuple[Matrix, Outcome]:
    """Return d (19,) after at most `STEPS` Newton steps, the point of least KKT residual, and its outcome.

    `rho` is the softness of eq. (4): 0 for fingertips that reach, above 0 keeps the least slack otherwise.
    """
    point = _Point(tables, nominal, limits, limits.weights * d)
    best, best_outcome = point, point.outcome(0)
    allowed = max(2.0 * best_outcome.residual, limits.tolerance)
    for count in range(1, STEPS + 1):
        point = _Point(tables, nominal, limits, point.z + point.step(rho))
        outcome = point.outcome(count)
        if outcome.kkt < best_outcome.kkt and outcome.residual <= allowed:
            best, best_outcome = point, outcome
        if outcome.kkt < limits.tolerance and outcome.residual < limits.tolerance:
            break
    return np.clip(best.z / limits.weights, limits.lower, limits.upper), best_outcome
