"""Convex hull of points in any dimension, point by point: the facets that see a point give way to a cone to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal.transform import Matrix

JOGGLE = 1e-10
"""Relative size of the fixed perturbation that keeps coplanar points from making flat simplices."""


@dataclass(frozen=True, slots=True, eq=False)
class Hull:
    """A hull of points (n, d): facets (m, d) as point indices, outward unit normals (m, d), offsets (m,).

    normals @ x <= offsets inside, for the points as given up to the joggle.
    """

    facets: NDArray[np.int64]
    normals: Matrix
    offsets: Matrix

    @property
    def vertices(self) -> NDArray[np.int64]:
        """Indices of the points that are corners of a facet."""
        return np.unique(self.facets)


def _first_simplex(points: Matrix, scale: float) -> list[int] | None:
    """Return d + 1 affinely independent points, each the farthest from those before it; None when there are none."""
    chosen = [int(np.argmin(points[:, 0]))]
    rest = points - points[chosen[0]]
    for _ in range(points.shape[1]):
        length = np.linalg.norm(rest, axis=1)
        farthest = int(np.argmax(length))
        if length[farthest] < 1e-7 * scale:
            return None
        chosen.append(farthest)
        direction = rest[farthest] / length[farthest]
        rest = rest - np.outer(rest @ direction, direction)
    return chosen


def _planes(points: Matrix, facets: NDArray[np.int64], inside: Matrix) -> Matrix:
    """Return a (m, d) with a . (x - inside) = 1 on each facet: no facet passes through a point inside."""
    corners = points[facets] - inside
    solved = np.linalg.solve(corners, np.ones((*corners.shape[:2], 1)))
    return np.asarray(solved[..., 0], dtype=np.float64)


def convex_hull(points: ArrayLike) -> Hull | None:
    """Return the hull of points (n, d), or None when they lie in a flat of lower dimension (to 1e-7 of their size)."""
    given = np.asarray(points, dtype=np.float64)
    if given.ndim != 2 or not np.all(np.isfinite(given)):
        raise ValueError(f"points must be a finite (n, d) array, got shape {given.shape}")
    n, d = given.shape
    scale = float(np.ptp(given, axis=0).max()) if n else 0.0
    first = _first_simplex(given, scale) if n > d and scale > 0 else None
    if first is None:
        return None
    x = given + np.random.default_rng(0).uniform(-1, 1, given.shape) * JOGGLE * scale
    inside = x[first].mean(axis=0)
    facets = np.array([[first[j] for j in range(d + 1) if j != i] for i in range(d + 1)])
    planes = _planes(x, facets, inside)
    remaining = [i for i in range(n) if i not in first]
    # Far points first: they swallow most facets that near ones would have made.
    for i in sorted(remaining, key=lambda k: -float(np.sum((x[k] - inside) ** 2))):
        seen = planes @ (x[i] - inside) > 1.0
        if not seen.any():
            continue
        visible = np.sort(facets[seen], axis=1)
        ridges = np.concatenate([np.delete(visible, j, axis=1) for j in range(d)])
        unique, counts = np.unique(ridges, axis=0, return_counts=True)
        horizon = unique[counts == 1]
        new = np.column_stack([horizon, np.full(len(horizon), i)])
        facets = np.concatenate([facets[~seen], new])
        planes = np.concatenate([planes[~seen], _planes(x, new, inside)])
    lengths = np.linalg.norm(planes, axis=1)
    normals = planes / lengths[:, None]
    return Hull(facets, normals, 1.0 / lengths + normals @ inside)
