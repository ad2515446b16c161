"""RRT-Connect (Kuffner and LaValle 2000) in the joint space of both arms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.hal.transform import Matrix
from preshape.planner.arm_collision import ArmCollision

REACH_RAD = 0.6
"""Longest edge of a tree, rad (max-norm)."""


class _Tree:
    """Points and parents of one tree in preallocated arrays."""

    def __init__(self, root: Matrix, capacity: int) -> None:
        self.points = np.empty((capacity, len(root)))
        self.parents = np.full(capacity, -1)
        self.points[0] = root
        self.count = 1

    def nearest(self, q: Matrix) -> int:
        return int(np.argmin(np.abs(self.points[: self.count] - q).max(axis=1)))

    def add(self, q: Matrix, parent: int) -> int:
        self.points[self.count], self.parents[self.count] = q, parent
        self.count += 1
        return self.count - 1

    @property
    def full(self) -> bool:
        return self.count == len(self.points)

    def branch(self, index: int) -> list[Matrix]:
        """Return the points from the root to a node."""
        points: list[Matrix] = []
        while index >= 0:
            points.append(self.points[index].copy())
            index = int(self.parents[index])
        return points[::-1]


def _extend(model: ArmCollision, tree: _Tree, near: int, q: Matrix, margins: Matrix, step: float) -> tuple[int, bool]:
    """Grow from a node towards q by at most `REACH_RAD`; return (node or -1 if blocked, whether q is reached)."""
    origin = tree.points[near]
    distance = float(np.abs(q - origin).max())
    reached = distance <= REACH_RAD
    target = q if reached else origin + (q - origin) * (REACH_RAD / distance)
    if tree.full or not model.edge_free(origin, target, margins, step):
        return -1, False
    return tree.add(target, near), reached


def _connect(model: ArmCollision, tree: _Tree, q: Matrix, margins: Matrix, step: float) -> tuple[int, bool]:
    """Grow towards q until it is reached or the way is blocked; return the last node and whether q is reached."""
    node = tree.nearest(q)
    while True:
        grown, reached = _extend(model, tree, node, q, margins, step)
        if grown < 0:
            return node, False
        node = grown
        if reached:
            return node, True


def grow_trees(
    model: ArmCollision,
    start: Matrix,
    goal: Matrix,
    moving: NDArray[np.int64],
    lower: Matrix,
    upper: Matrix,
    margins: Matrix,
    step: float,
    iterations: int,
    rng: np.random.Generator,
) -> Matrix | None:
    """Return way-points (n, 14) from start to goal found by two trees over the `moving` joints, or None."""
    capacity = 4 * iterations + 2
    trees = (_Tree(start, capacity), _Tree(goal, capacity))
    for iteration in range(iterations):
        growing, other = trees[iteration % 2], trees[1 - iteration % 2]
        q = start.copy()
        q[moving] = rng.uniform(lower[moving], upper[moving])
        node, _ = _extend(model, growing, growing.nearest(q), q, margins, step)
        if node < 0:
            continue
        meeting, reached = _connect(model, other, growing.points[node], margins, step)
        if reached:
            halves = growing.branch(node), other.branch(meeting)[::-1]
            path = np.array(halves[0] + halves[1][1:])
            return path if iteration % 2 == 0 else path[::-1].copy()
        if growing.full or other.full:
            return None
    return None
