"""Objects that are not boxes: convex parts from primitives or meshes, each with its smallest oriented box (III-A)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.transform import Matrix, axis_rotation, transform
from preshape.planner.convex_hull import Hull, convex_hull
from preshape.planner.directions import square_to

CYLINDER_SIDES = 16
"""Sides of the prism around a cylinder; a multiple of 4 keeps its smallest box exact."""

EDGE_PAIRS_MAX = 40
"""Up to this many edge directions, boxes touched by two edges on one face are tried as well."""

_SHORT = 1e-6
_REFINE_DEG = (3.0, 1.0, 0.3, 0.1, 0.03, 0.01)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One convex part: the corners (n, 3) of its hull in the object's frame, m."""

    name: str
    vertices: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class MinimumBox:
    """The smallest box around a part: its pose in the object's frame and half edges (3,), m.

    Its axes are named so that they are as close to the object's as they can be.
    """

    name: str
    X_object_box: Matrix
    half: Matrix

    @property
    def volume(self) -> float:
        """Volume, m3."""
        return float(8.0 * np.prod(self.half))


def box_part(name: str, size: ArrayLike, X_object_part: Matrix | None = None) -> Part:
    """Return a box of outer size (3,) m, centred in its frame."""
    half = np.asarray(size, float) / 2.0
    if half.shape != (3,) or not np.all(half > 0):
        raise ValueError(f"part {name}: size must be 3 positive lengths, got {size} m")
    return _placed(name, np.array(list(product((-1.0, 1.0), repeat=3))) * half, X_object_part)


def cylinder_part(name: str, radius: float, height: float, X_object_part: Matrix | None = None) -> Part:
    """Return the prism of `CYLINDER_SIDES` faces around a cylinder along z, centred in its frame, m."""
    if not (radius > 0 and height > 0):
        raise ValueError(f"part {name}: radius and height must be > 0, got {radius} m and {height} m")
    angles = (np.arange(CYLINDER_SIDES) + 0.5) * 2.0 * np.pi / CYLINDER_SIDES
    ring = radius / np.cos(np.pi / CYLINDER_SIDES) * np.column_stack([np.cos(angles), np.sin(angles)])
    ends = [np.column_stack([ring, np.full(CYLINDER_SIDES, z)]) for z in (-height / 2.0, height / 2.0)]
    return _placed(name, np.vstack(ends), X_object_part)


def mesh_part(name: str, vertices: ArrayLike, X_object_part: Matrix | None = None) -> Part:
    """Return the convex hull of a mesh's vertices (n, 3), m; `ValueError` for a flat or non-finite mesh."""
    points = np.asarray(vertices, float)
    hull = convex_hull(points)
    if hull is None:
        raise ValueError(f"part {name}: {len(points)} vertices that span no volume")
    return _placed(name, points[hull.vertices], X_object_part)


def l_carton_parts(size: ArrayLike, arm: float) -> tuple[Part, Part]:
    """Return an L in the x-z plane of outer size (3,) m: an upright (z) and a foot (x), both `arm` thick, centred.

    The upright stands on the foot's -x end; together they fill the outer size but for the corner at +x +z.
    """
    x, y, z = np.asarray(size, float)
    if not 0.0 < arm < min(x, z):
        raise ValueError(f"arm must be above 0 and below {min(x, z)} m, got {arm} m")
    upright = box_part("upright", (arm, y, z), transform([(arm - x) / 2.0, 0.0, 0.0]))
    foot = box_part("foot", (x - arm, y, arm), transform([arm / 2.0, 0.0, (arm - z) / 2.0]))
    return upright, foot


def _placed(name: str, points: Matrix, X: Matrix | None) -> Part:
    vertices = points if X is None else points @ X[:3, :3].T + X[:3, 3]
    vertices = np.array(vertices)
    vertices.setflags(write=False)
    return Part(name, vertices)


def _unique_directions(vectors: Matrix) -> Matrix:
    """Return unit directions without repeats; a direction and its opposite are the same."""
    lengths = np.linalg.norm(vectors, axis=1)
    kept: dict[tuple[float, ...], Matrix] = {}
    for i in np.flatnonzero(lengths > _SHORT * lengths.max()):
        unit: Matrix = vectors[i] / lengths[i]
        # The first coordinate that is not zero decides which of two opposite directions stands for both.
        unit = unit * np.sign(unit[int(np.argmax(np.abs(unit) > 1e-6))])
        kept.setdefault(tuple(np.round(unit, 6).tolist()), unit)
    return np.array(list(kept.values()))


def _hull_edges(points: Matrix, hull: Hull) -> Matrix:
    pairs = np.concatenate([hull.facets[:, [0, 1]], hull.facets[:, [1, 2]], hull.facets[:, [2, 0]]])
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    return points[pairs[:, 1]] - points[pairs[:, 0]]


def _volume(points: Matrix, R: Matrix) -> float:
    turned = points @ R
    extent: Matrix = turned.max(axis=0) - turned.min(axis=0)
    return float(extent[0] * extent[1] * extent[2])


def _best_turn(points: Matrix, normal: Matrix, edges: Matrix) -> tuple[float, Matrix]:
    """Return volume and rotation of the smallest box with one face square to `normal`: a side lies along an edge."""
    u, v = square_to(normal)
    plane = np.column_stack([u, v])
    flat = edges @ plane
    flat = flat[np.linalg.norm(flat, axis=1) > 1e-6]
    angles = np.unique(np.round(np.arctan2(flat[:, 1], flat[:, 0]) % (np.pi / 2), 9))
    c, s = np.cos(angles), np.sin(angles)
    x, y = (points @ plane).T
    along = np.ptp(np.outer(x, c) + np.outer(y, s), axis=0)
    area = along * np.ptp(np.outer(y, c) - np.outer(x, s), axis=0)
    k = int(np.argmin(area))
    R = np.column_stack([c[k] * u + s[k] * v, c[k] * v - s[k] * u, normal])
    return float(area[k] * np.ptp(points @ normal)), R


def _refined(points: Matrix, rotation: Matrix) -> Matrix:
    """Turn a box by smaller and smaller angles about its own axes while it shrinks."""
    best = _volume(points, rotation)
    for step in np.deg2rad(_REFINE_DEG):
        improved = True
        while improved:
            improved = False
            for axis, sign in product(np.eye(3), (-1.0, 1.0)):
                turned = rotation @ axis_rotation(axis, sign * float(step))
                volume = _volume(points, turned)
                if volume < best * (1.0 - 1e-9):
                    rotation, best, improved = turned, volume, True
    return rotation


def _named_like_object(R: Matrix) -> Matrix:
    """Return the same axes in the order and with the signs that turn least away from the object's frame."""
    best = R
    for order in permutations(range(3)):
        columns = R[:, order]
        signs = np.where(np.diag(columns) < 0, -1.0, 1.0)
        turned = columns * signs
        if np.linalg.det(turned) < 0:
            weakest = int(np.argmin(np.abs(np.diag(turned))))
            turned[:, weakest] *= -1.0
        if np.trace(turned) > np.trace(best) + 1e-9 or np.linalg.det(best) < 0:
            best = turned
    return best


def minimum_box(part: Part) -> MinimumBox:
    """Return the smallest oriented box around a part.

    Tried are all boxes with a face on a face of the hull and a side along one of its edges (rotating calipers),
    and, for hulls of few edges, boxes with two edges of the hull on one face; the best is refined by small
    turns. Exact for boxes, prisms and simplices; of equal boxes the one turned least from the object wins.

    Raises:
        ValueError: the part's vertices span no volume.
    """
    hull = convex_hull(part.vertices)
    if hull is None:
        raise ValueError(f"part {part.name}: {len(part.vertices)} vertices that span no volume")
    points = part.vertices[hull.vertices]
    edges = _unique_directions(_hull_edges(part.vertices, hull))
    normals: Matrix = hull.normals
    if len(edges) <= EDGE_PAIRS_MAX:
        first, second = np.triu_indices(len(edges), 1)
        normals = np.vstack([normals, np.cross(edges[first], edges[second])]).astype(np.float64)
    found = [_best_turn(points, normal, edges) for normal in list(_unique_directions(normals))]
    smallest = min(volume for volume, _ in found)
    ties = [_named_like_object(R) for volume, R in found if volume <= smallest * (1.0 + 1e-6)]
    R = _refined(points, max(ties, key=lambda candidate: float(np.trace(candidate))))
    low, high = (points @ R).min(axis=0), (points @ R).max(axis=0)
    return MinimumBox(part.name, transform(R @ (low + high) / 2.0, R), (high - low) / 2.0)
