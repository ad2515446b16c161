"""Whether an arm reaches a palm pose, how well, and with which joint angles.

score = min(degrees to the nearest joint limit, 600 x manipulability), manipulability = sqrt(det(J J^T))
(Yoshikawa 1985) of the palm's Jacobian in m and rad: both terms are near 20 in an easy posture.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.compiled import compiled
from preshape.hal.layout import ARM_DOF, SIDES, Side
from preshape.hal.transform import Matrix
from preshape.planner.arm_collision import ArmCollision, arms_vector
from preshape.planner.arm_ik import IkGrid, joint_range, solve_palm
from preshape.planner.arm_kinematics import FRAME_COUNT, chain_frames, joint_vector, link_origins, mount, palm_jacobian

MANIPULABILITY_WEIGHT = 600.0
"""Degrees that one unit of manipulability is worth."""


@compiled
def _manipulability2(J: Matrix) -> float:
    """Return det(J J^T) of J (6, 7) by elimination (the matrix is positive semidefinite: no pivoting)."""
    A = J @ J.T
    determinant = 1.0
    for k in range(6):
        pivot = A[k, k]
        if pivot <= 1e-15:
            return 0.0
        determinant *= pivot
        for i in range(k + 1, 6):
            factor = A[i, k] / pivot
            for j in range(k, 6):
                A[i, j] -= factor * A[k, j]
    return determinant


@compiled
def _scores(
    origins: Matrix, base: Matrix, X_link7_palm: Matrix, lower: Matrix, upper: Matrix, qs: Matrix, out: Matrix
) -> None:
    frames, J = np.empty((FRAME_COUNT, 4, 4)), np.empty((6, ARM_DOF))
    for n in range(qs.shape[0]):
        chain_frames(origins, base, X_link7_palm, qs[n], frames)
        palm_jacobian(frames, J)
        margin = min(np.min(qs[n] - lower), np.min(upper - qs[n]))
        out[n] = min(np.rad2deg(margin), MANIPULABILITY_WEIGHT * np.sqrt(_manipulability2(J)))


def scores(side: Side, qs: ArrayLike) -> Matrix:
    """Return the score of each row of qs (n, 7), rad; negative outside the limits. The base's pose does not matter."""
    qs = np.ascontiguousarray(qs, dtype=float)
    if qs.ndim != 2 or qs.shape[1] != ARM_DOF:
        raise ValueError(f"arm joints: got shape {qs.shape}, allowed is (n, {ARM_DOF})")
    lower, upper = joint_range()
    out = np.empty(len(qs))
    _scores(link_origins(), np.eye(4), mount(side), lower, upper, qs, out)
    return out


def score(side: Side, q: ArrayLike) -> float:
    """Return the score of one posture q (7), rad."""
    return float(scores(side, joint_vector(q)[None])[0])


class ReachStatus(IntEnum):
    """Why an arm can or cannot take a palm pose."""

    REACHABLE = 0
    NO_SOLUTION = 1
    COLLIDES = 2


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """The answer: `q` (7) and its score when REACHABLE; `nearest` names the bodies in the way when COLLIDES."""

    status: ReachStatus
    q: Matrix = field(default_factory=lambda: np.full(ARM_DOF, np.nan))
    score: float = 0.0
    nearest: tuple[str, str] = ("", "")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReachQuery:
    """What counts as reachable.

    Attributes:
        grid: how the redundancy is sampled.
        margin_m: clearance that the coarse shapes must keep.
        more_m: added to it from obstacles that have appeared.
        travel_weight: score given up per rad of the largest joint change from `near`.
        least_score: postures below it are not taken.
    """

    grid: IkGrid = IkGrid()
    margin_m: float = 0.01
    more_m: float = 0.0
    travel_weight: float = 5.0
    least_score: float = 2.0


def ranked_postures(
    side: Side,
    X_world_base: Matrix,
    X_world_palm: Matrix,
    query: ReachQuery | None = None,
    near: ArrayLike | None = None,
) -> tuple[Matrix, Matrix]:
    """Return all postures (n, 7), best first, and their ranks: score less the travel from `near` (7), if given."""
    query = query or ReachQuery()
    qs = solve_palm(side, X_world_base, X_world_palm, query.grid)
    values = scores(side, qs)
    taken = values >= query.least_score
    qs, values = qs[taken], values[taken]
    if near is not None and len(qs):
        values = values - query.travel_weight * np.abs(qs - joint_vector(near)).max(axis=1)
    order = np.argsort(-values, kind="stable")
    return qs[order], values[order]


def reach(
    side: Side,
    X_world_base: Matrix,
    X_world_palm: Matrix,
    collision: ArmCollision | None = None,
    q_arms: ArrayLike | None = None,
    query: ReachQuery | None = None,
    near: ArrayLike | None = None,
) -> Reach:
    """Return the best posture of one arm for a palm pose that is free of coarse collisions.

    `q_arms` (14) places the other arm when `collision` is given (`ValueError` without it); this arm's
    part of it is ignored. `near` (7) prefers postures that take less travel.
    """
    query = query or ReachQuery()
    qs, _ = ranked_postures(side, X_world_base, X_world_palm, query, near)
    if not len(qs):
        return Reach(ReachStatus.NO_SOLUTION)
    if collision is None:
        return Reach(ReachStatus.REACHABLE, qs[0], score(side, qs[0]))
    if q_arms is None:
        raise ValueError("q_arms: needed to place the other arm when a collision model is given")
    q_all = arms_vector(q_arms).copy()
    own = slice(SIDES.index(side) * ARM_DOF, (SIDES.index(side) + 1) * ARM_DOF)
    for q in qs:
        q_all[own] = q
        if collision.is_free(q_all, query.margin_m, query.more_m):
            return Reach(ReachStatus.REACHABLE, q, score(side, q))
    q_all[own] = qs[0]
    return Reach(ReachStatus.COLLIDES, nearest=collision.clearance(q_all).bodies)
