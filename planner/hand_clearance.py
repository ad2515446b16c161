"""How far each part of a hand stays clear of a box: sampled, to rank preshapes; the controller has exact distances."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal import sah_hand
from preshape.hal.layout import Side
from preshape.hal.transform import Matrix
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


def part_clearances(side: Side, X_box_palm: Matrix, joints: ArrayLike, half: ArrayLike) -> Matrix:
    """Return each part's distance (18,) from a box with half edges `half` about its frame, m; negative inside.

    Parts that are boxes are sampled on a grid, so a thin box may pass between samples unseen: the value is an
    upper bound, off by a few mm at most for boxes larger than the grid's cells (23 mm).
    """
    parts, points, radii = _samples(side)
    X = X_box_palm @ hand_kinematics(side).part_poses(joints)
    at = np.einsum("nij,nj->ni", X[parts, :3, :3], points) + X[parts, :3, 3]
    clearance = np.full(len(PART_NAMES), np.inf)
    np.minimum.at(clearance, parts, box_distance(at, half) - radii)
    return clearance
