"""Postures of one arm through a series of palm poses: the redundancy is chosen for all of them together.

Each pose has a set of postures (closed form, joint 7 sampled). Dynamic programming picks one a pose so that
the sum of (largest joint change)^2 + limit_weight / score, score in degrees (`arm_reach.score`), is least. A
posture chosen for the first pose alone often ends at a joint limit a few poses later.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.layout import ARM_DOF, Side
from preshape.hal.transform import Matrix
from preshape.planner.arm_ik import IkGrid, solve_palm
from preshape.planner.arm_kinematics import joint_vector
from preshape.planner.arm_reach import scores


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainQuery:
    """What counts as a chain.

    Attributes:
        grid: how the redundancy is sampled.
        least_score: postures below it are not taken.
        largest_step_rad: largest joint change from one pose to the next.
        limit_weight: cost of a posture is this over its score.
        most: postures kept for one pose, those of best score.
    """

    grid: IkGrid = IkGrid(q7_samples=61)
    least_score: float = 4.0
    largest_step_rad: float = 0.5
    limit_weight: float = 0.3
    most: int = 160


def posture_chain(
    side: Side,
    X_world_base: Matrix,
    X_world_palms: Matrix,
    near: ArrayLike | None = None,
    is_free: Callable[[int, Matrix], bool] = lambda number, q: True,
    query: ChainQuery | None = None,
) -> Matrix | None:
    """Return postures (n, 7), rad, for palm poses (n, 4, 4), or None if no chain joins them.

    `near` (7) draws the first posture; `is_free(number, q)` says whether pose `number` may be taken with q.
    """
    query = query or ChainQuery()
    sets: list[Matrix] = []
    costs: list[Matrix] = []
    for number, X in enumerate(X_world_palms):
        qs, cost = _candidates(side, X_world_base, X, query)
        free = np.array([is_free(number, q) for q in qs], dtype=bool)
        if not free.any():
            return None
        sets.append(qs[free])
        costs.append(cost[free])
    return _cheapest(sets, costs, near, query)


def _candidates(side: Side, X_world_base: Matrix, X: Matrix, query: ChainQuery) -> tuple[Matrix, Matrix]:
    qs = solve_palm(side, X_world_base, X, query.grid)
    values = scores(side, qs) if len(qs) else np.empty(0)
    order = np.argsort(-values, kind="stable")
    order = order[values[order] >= query.least_score][: query.most]
    return qs[order].reshape(-1, ARM_DOF), query.limit_weight / values[order]


def _cheapest(sets: list[Matrix], costs: list[Matrix], near: ArrayLike | None, query: ChainQuery) -> Matrix | None:
    total = costs[0].copy()
    if near is not None:
        total += np.abs(sets[0] - joint_vector(near)).max(axis=1) ** 2
    chosen: list[np.ndarray] = []
    for before, after, cost in zip(sets[:-1], sets[1:], costs[1:], strict=True):
        step = np.abs(before[:, None] - after[None]).max(axis=2)
        price = total[:, None] + np.where(step <= query.largest_step_rad, step**2, np.inf)
        chosen.append(price.argmin(axis=0))
        total = price.min(axis=0) + cost
    if not np.isfinite(total).any():
        return None
    k = int(total.argmin())
    picked = [k]
    for back in reversed(chosen):
        k = int(back[k])
        picked.append(k)
    return np.array([qs[k] for qs, k in zip(sets, reversed(picked), strict=True)])
