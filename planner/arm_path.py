"""A joint path between two arm configurations that keeps the coarse shapes apart.

The straight joint path if it is free; else one via-point; else a deterministic RRT-Connect (Kuffner and
LaValle 2000) over the joints of the arms that move, shortened. The same query always gives the same path.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal.layout import ARM_DOF, LAYOUT, SIDES
from preshape.hal.transform import Matrix
from preshape.planner.arm_collision import ArmCollision, arms_vector
from preshape.planner.arm_tree import grow_trees


class PathStatus(IntEnum):
    """How a path query ended."""

    FOUND = 0
    START_BLOCKED = 1
    GOAL_BLOCKED = 2
    OUTSIDE_LIMITS = 3
    NOT_FOUND = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class PathQuery:
    """What counts as a path.

    Attributes:
        margin_m: clearance to keep; two bodies that have less at start or goal keep what they have, less 1 mm.
        more_m: added to it where one of them is an obstacle that has appeared.
        step_rad: largest joint change between two checked samples.
        limit_margin_rad: via-points stay this far inside the joint limits.
        iterations: most samples the trees may draw.
        shortcuts: attempts to shorten a path found by the trees.
        seed: of the generator that samples are drawn from.
    """

    margin_m: float = 0.02
    more_m: float = 0.0
    step_rad: float = 0.04
    limit_margin_rad: float = 0.05
    iterations: int = 4000
    shortcuts: int = 60
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class ArmPath:
    """A path as way-points (n, 14), rad, from start to goal, and the margin (m) that all keep; bodies name a block."""

    status: PathStatus
    waypoints: Matrix
    margin: float = 0.0
    bodies: tuple[str, str] = ("", "")

    @property
    def by_chance(self) -> bool:
        """Whether another seed would give another path: not if it is straight, or an end is not free."""
        return self.status is PathStatus.NOT_FOUND or len(self.waypoints) > 2

    @property
    def length(self) -> float:
        """Sum of the largest joint changes of all legs, rad."""
        if len(self.waypoints) < 2:
            return 0.0
        return float(np.abs(np.diff(self.waypoints, axis=0)).max(axis=1).sum())


ALLOWED_DIP = 0.001
"""What a path may lose of the clearance that its own ends have, m."""


TREMBLE = 2e-4
"""What two bodies that stand near each other may come nearer on a way out, m."""
SMALLEST_OUT_RAD, LARGEST_OUT_RAD, WAYS_OUT = 0.03, 0.5, 1500
"""Largest joint change of the first and the last posture that is tried for a way out, and how many are."""


def arm_limits(margin: float) -> tuple[Matrix, Matrix]:
    """Return lower and upper limits (14,) of right then left arm, drawn in by a margin, rad."""
    lower = np.concatenate([LAYOUT.lower[LAYOUT.arm(side)] for side in SIDES])
    upper = np.concatenate([LAYOUT.upper[LAYOUT.arm(side)] for side in SIDES])
    return lower + margin, upper - margin


def _none(status: PathStatus, bodies: tuple[str, str] = ("", "")) -> ArmPath:
    return ArmPath(status, np.empty((0, len(arm_limits(0.0)[0]))), bodies=bodies)


def plan_path(model: ArmCollision, q_start: ArrayLike, q_goal: ArrayLike, query: PathQuery | None = None) -> ArmPath:
    """Return a path from q_start to q_goal, each (14): right arm, left arm, rad.

    An arm whose joints are the same at both ends stays where it is. START_BLOCKED / GOAL_BLOCKED: that
    end overlaps, `bodies` says what; OUTSIDE_LIMITS: an end is outside the joint limits; NOT_FOUND: the
    iterations are used up.
    """
    query = query or PathQuery()
    start, goal = arms_vector(q_start).copy(), arms_vector(q_goal).copy()
    lower, upper = arm_limits(0.0)
    if (np.minimum(start, goal) < lower - 1e-9).any() or (np.maximum(start, goal) > upper + 1e-9).any():
        return _none(PathStatus.OUTSIDE_LIMITS)
    for q, blocked in ((start, PathStatus.START_BLOCKED), (goal, PathStatus.GOAL_BLOCKED)):
        clearance = model.clearance(q)
        if clearance.distance < 0.0:
            return _none(blocked, clearance.bodies)
    margins = model.margins(query.margin_m, (start, goal), ALLOWED_DIP, query.more_m)
    waypoints = _search(model, start, goal, margins, query)
    if waypoints is None:
        return _none(PathStatus.NOT_FOUND)
    return ArmPath(PathStatus.FOUND, waypoints, float(margins.min(initial=query.margin_m)))


def way_out(
    model: ArmCollision, q_start: ArrayLike, moving: NDArray[np.int64], query: PathQuery, there: ArmCollision
) -> Matrix | None:
    """Return q (14), rad, a straight way from q_start, where all keep the query's margin; None if none is found.

    `model` holds on the way, on which no two come nearer than they are at the start, but for `TREMBLE` m; `there`
    holds at its end. The nearest of random postures of the joints `moving`; the same query always gives the same.
    """
    start = arms_vector(q_start)
    margins = model.margins(query.margin_m, (start,), TREMBLE, query.more_m)
    low, high = arm_limits(0.0)
    rng = np.random.default_rng(query.seed)
    for size in np.linspace(SMALLEST_OUT_RAD, LARGEST_OUT_RAD, WAYS_OUT):
        q = start.copy()
        turn = rng.normal(size=len(moving))
        q[moving] = np.clip(start[moving] + size * turn / np.abs(turn).max(), low[moving], high[moving])
        free = there.is_free(q, query.margin_m, query.more_m)
        if free and model.edge_free(start, q, margins, query.step_rad):
            return q
    return None


def _search(model: ArmCollision, start: Matrix, goal: Matrix, margins: Matrix, query: PathQuery) -> Matrix | None:
    if model.edge_free(start, goal, margins, query.step_rad):
        return np.array([start, goal])
    rng = np.random.default_rng(query.seed)
    moving = _moving_joints(start, goal)
    low, high = arm_limits(query.limit_margin_rad)
    low, high = np.minimum(low, np.minimum(start, goal)), np.maximum(high, np.maximum(start, goal))
    found = _one_via(model, start, goal, margins, query, rng, moving)
    if found is None:
        found = grow_trees(model, start, goal, moving, low, high, margins, query.step_rad, query.iterations, rng)
    return None if found is None else _shorten(model, found, margins, query, rng)


def _moving_joints(start: Matrix, goal: Matrix) -> NDArray[np.int64]:
    """Return the indices (in 14) of the joints of every arm that has to move."""
    arms = np.abs(goal - start).reshape(len(SIDES), ARM_DOF).max(axis=1) > 0.0
    return np.flatnonzero(np.repeat(arms, ARM_DOF))


def _one_via(
    model: ArmCollision,
    start: Matrix,
    goal: Matrix,
    margins: Matrix,
    query: PathQuery,
    rng: np.random.Generator,
    moving: NDArray[np.int64],
) -> Matrix | None:
    """Return a path over one via-point near the middle of the straight one, or None."""
    low, high = arm_limits(query.limit_margin_rad)
    for attempt in range(24):
        via = 0.5 * (start + goal)
        via[moving] += rng.uniform(-1.0, 1.0, len(moving)) * (0.3 + 0.05 * attempt)
        via[moving] = np.clip(via[moving], low[moving], high[moving])
        if model.edge_free(start, via, margins, query.step_rad) and model.edge_free(via, goal, margins, query.step_rad):
            return np.array([start, via, goal])
    return None


def _shorten(model: ArmCollision, path: Matrix, margins: Matrix, query: PathQuery, rng: np.random.Generator) -> Matrix:
    """Return the path with random pairs of points on it joined directly where that is free and shorter."""
    for _ in range(query.shortcuts):
        if len(path) < 3:
            break
        i, j = sorted(rng.choice(len(path) - 1, 2, replace=False))
        a = path[i] + rng.uniform() * (path[i + 1] - path[i])
        b = path[j] + rng.uniform() * (path[j + 1] - path[j])
        if model.edge_free(a, b, margins, query.step_rad):
            path = np.vstack([path[: i + 1], a, b, path[j + 1 :]])
            path = path[np.r_[True, np.abs(np.diff(path, axis=0)).max(axis=1) > 1e-9]]
    return path
