"""How far a hand stays clear of a box: sampled, to rank preshapes; the controller has exact distances."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal import sah_hand
from preshape.hal.compiled import compiled
from preshape.hal.layout import Side
from preshape.hal.transform import Matrix, inverse
from preshape.hal.world import OrientedBox
from preshape.planner.hand_kinematics import PART_NAMES, hand_kinematics

BOX_SAMPLES = 7
"""Points along each edge direction of a box-shaped part."""

CAPSULE_SAMPLES = 7
"""Points along the axis of a capsule."""


@cache
def _samples(side: Side) -> tuple[NDArray[np.int64], Matrix, Matrix]:
    """Return part index, point in the part's frame (m) and radius (m) of every sample."""
    parts: list[int] = []
    points: list[Matrix] = []
    radii: list[float] = []
    mirror = np.array([1.0, 1.0 if side == "right" else -1.0, 1.0])
    grid = np.stack(np.meshgrid(*3 * [np.linspace(-1, 1, BOX_SAMPLES)]), axis=-1).reshape(-1, 3)
    surface = grid[np.abs(grid).max(axis=1) == 1.0]
    for index, name in enumerate(PART_NAMES):
        shape, _ = sah_hand.PARTS[name]
        if shape.kind == "box":
            at, radius = np.array(shape.center) + surface * np.array(shape.size), 0.0
        else:
            radius, start, end = shape.size
            at = np.array(shape.center) + np.outer(np.linspace(start, end, CAPSULE_SAMPLES), [1.0, 0.0, 0.0])
        parts += [index] * len(at)
        points += list(at * mirror)
        radii += [radius] * len(at)
    return np.array(parts), np.array(points), np.array(radii)


def box_distance(points: Matrix, half: ArrayLike) -> Matrix:
    """Return the signed Euclidean distance (n,) of points (n, 3) from an axis-aligned box about the origin, m."""
    q = np.abs(points) - np.asarray(half, float)
    return np.linalg.norm(np.maximum(q, 0.0), axis=-1) + np.minimum(q.max(axis=-1), 0.0)


@lru_cache(maxsize=256)
def _points(side: Side, joints: bytes) -> tuple[Matrix, Matrix]:
    parts, points, radii = _samples(side)
    X = hand_kinematics(side).part_poses(np.frombuffer(joints))
    return np.einsum("nij,nj->ni", X[parts, :3, :3], points) + X[parts, :3, 3], radii


@compiled
def _least(points: Matrix, radii: Matrix, R: Matrix, p: Matrix, half: Matrix) -> float:
    """Return the least of |R x + p from the box| - radius over all points x."""
    least = np.inf
    for n in range(points.shape[0]):
        outside, deepest = 0.0, -np.inf
        for i in range(3):
            at = R[i, 0] * points[n, 0] + R[i, 1] * points[n, 1] + R[i, 2] * points[n, 2] + p[i]
            gap = abs(at) - half[i]
            deepest = max(deepest, gap)
            if gap > 0.0:
                outside += gap * gap
        least = min(least, (np.sqrt(outside) if outside > 0.0 else deepest) - radii[n])
    return least


def hand_clearance(side: Side, X_world_palm: Matrix, joints: Matrix, boxes: Iterable[OrientedBox]) -> tuple[float, str]:
    """Return the hand's least distance from boxes in the world, m, negative inside, and the nearest one's name.

    Parts that are boxes are sampled on a grid, so a thin box may pass between samples unseen: the value is an
    upper bound, off by a few mm at most for boxes larger than the grid's cells (23 mm).
    """
    points, radii = _points(side, np.ascontiguousarray(joints, dtype=float).tobytes())
    nearest = np.inf, ""
    for box in boxes:
        X = inverse(box.X_world_box) @ X_world_palm
        distance = _least(points, radii, X[:3, :3], X[:3, 3], np.asarray(box.half, float))
        nearest = min(nearest, (distance, box.name))
    return nearest
