"""Does a grasp hold? The paper's line test (section III-D) and the friction-cone test with the Ferrari-Canny metric."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.layout import Side
from preshape.hal.transform import Matrix, cross
from preshape.planner.convex_hull import convex_hull
from preshape.planner.directions import square_to
from preshape.planner.grasping_plane import grasping_plane

CONE_EDGES = 8
"""Edges of the pyramid inside each friction cone: it understates the cone by at most 8 %."""

LINE_TOLERANCE = 1e-9
"""A line that passes this close to the fingertips' triangle goes through it (a single finger is a point), m."""


@dataclass(frozen=True, slots=True)
class ForceClosure:
    """Both verdicts on one grasp.

    `line_margin_m`: how far inside the triangle or segment of the fingertips the line through the thumb's tip
    passes (negative: outside), m. `epsilon`: largest wrench that every direction is sure of, for contact forces
    whose sum is 1 N, in N (torques divided by `length_m`); 0 when the contacts cannot span all wrenches, and
    negative when not even the origin is inside.
    """

    line_margin_m: float
    epsilon: float
    length_m: float

    @property
    def by_line(self) -> bool:
        """The paper's condition."""
        return self.line_margin_m >= -LINE_TOLERANCE

    @property
    def by_cones(self) -> bool:
        """The friction-cone condition."""
        return self.epsilon > 1e-9


def line_margin(tips: ArrayLike, side: Side) -> float:
    """Return how far inside the others' triangle (segment, point) the thumb's line along the plane's x passes, m.

    In the grasping plane's y-z plane: for a triangle the least distance to its sides, for a segment the distance
    to the nearer end less the distance beside it, for a point minus the distance to it; negative outside.
    """
    p = np.asarray(tips, float)
    X = grasping_plane(p, side)
    flat = (p - p[0]) @ X[:3, 1:3]
    others = flat[1:]
    if len(others) == 1:
        return -float(np.linalg.norm(others[0]))
    if len(others) == 2:
        a, b = others
        along = (b - a) / np.linalg.norm(b - a)
        beside = abs(float(along[0] * a[1] - along[1] * a[0]))
        return min(-float(a @ along), float(b @ along)) - beside
    sides = np.roll(others, -1, axis=0) - others
    # The origin is the thumb: the cross product with each side says on which side of it the line passes.
    crosses = sides[:, 0] * -others[:, 1] - sides[:, 1] * -others[:, 0]
    area = sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0]
    distance = np.sign(area) * crosses / np.linalg.norm(sides, axis=1)
    return float(distance.min())


def cone_wrenches(
    points: ArrayLike, normals: ArrayLike, friction: float, center: ArrayLike, length: float, torsion: float = 0.0
) -> Matrix:
    """Return the wrenches (n, 6) of unit normal forces at the edges of every friction cone.

    Args:
        points: contact points (k, 3), m.
        normals: unit normals into the object (k, 3).
        friction: Coulomb coefficient.
        center: where torques are taken (3,), m.
        length: what torques are divided by, m.
        torsion: largest moment about the normal over the normal force (a soft fingertip), m; 0 = a point contact.
    """
    wrenches: list[Matrix] = []
    angles = np.arange(CONE_EDGES) * 2.0 * np.pi / CONE_EDGES
    for p, n in zip(np.asarray(points, float), np.asarray(normals, float), strict=True):
        u, v = square_to(n)
        forces = n + friction * (np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v))
        moments = np.cross(p - np.asarray(center, float), forces)
        wrenches.append(np.column_stack([forces, moments / length]))
        if torsion > 0.0:
            pure = np.concatenate([n, cross(p - np.asarray(center, float), n) / length])
            spin = np.concatenate([np.zeros(3), n * torsion / length])
            wrenches.append(np.array([pure + spin, pure - spin]))
    return np.vstack(wrenches)


def ferrari_canny(wrenches: ArrayLike) -> float:
    """Return the radius of the largest ball about the origin inside the convex hull of wrenches (n, 6).

    Ferrari and Canny's metric for contact forces whose sum is bounded; 0 when the wrenches span fewer than 6
    dimensions, negative (minus the distance of the farthest facet's plane) when the origin is outside.
    """
    hull = convex_hull(wrenches)
    return 0.0 if hull is None else float(hull.offsets.min())


def force_closure(
    tips: ArrayLike, contacts: ArrayLike, normals: ArrayLike, friction: float, side: Side, torsion: float = 0.0
) -> ForceClosure:
    """Judge a grasp by both tests.

    Args:
        tips: fingertip frames (n, 3), thumb first, for the line test, m.
        contacts: where the fingertips touch (n, 3), m.
        normals: unit normals into the object there (n, 3).
        friction: Coulomb coefficient, > 0.
        side: the hand, for the grasping plane.
        torsion: see `cone_wrenches`; two point contacts cannot resist a turn about their line without it.
    """
    points = np.asarray(contacts, float)
    if not friction > 0:
        raise ValueError(f"friction must be > 0, got {friction}")
    center = points.mean(axis=0)
    length = float(np.linalg.norm(points - center, axis=1).max())
    wrenches = cone_wrenches(points, normals, friction, center, length, torsion)
    return ForceClosure(line_margin(tips, side), ferrari_canny(wrenches), length)
