"""What the renderer draws: primitives and convex bodies with a pose and a colour, and lines made of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.transform import Matrix, cross, transform
from preshape.planner.convex_hull import convex_hull
from preshape.tools.raster_kernels import FACETS

Kind = Literal["box", "capsule", "cylinder", "ellipsoid", "convex"]
Color = tuple[float, float, float]

NO_PLANES = np.zeros((0, 4))


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One body to draw: a pose, a size and a colour.

    `size` (3,), m: half edges of a box, half axes of an ellipsoid, (radius, half length along z, 0) of a
    cylinder; a capsule's half length is that of its straight part; for a convex body the half edges of a box
    around it, centred in its frame, beside `planes` (m, 4): unit normals and offsets, n . x <= b inside.
    `flat` shapes (lines, marks) are drawn in their plain colour without edges.
    """

    kind: Kind
    X_world_shape: Matrix
    size: Matrix
    color: Color = (0.7, 0.7, 0.7)
    flat: bool = False
    planes: Matrix = field(default_factory=lambda: NO_PLANES)

    def __post_init__(self) -> None:
        if len(self.planes) > FACETS:
            raise ValueError(f"a convex body may have {FACETS} planes, got {len(self.planes)}")

    def half(self) -> Matrix:
        """Return the half edges of the shape's bounding box in its own frame, m."""
        if self.kind in ("box", "ellipsoid", "convex"):
            return np.asarray(self.size, float)
        radius, length = float(self.size[0]), float(self.size[1])
        return np.array([radius, radius, length + (radius if self.kind == "capsule" else 0.0)])


def segment(start: ArrayLike, end: ArrayLike, radius: float, color: Color) -> Shape:
    """Return a line between two points (world, m) as a thin flat capsule."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    along = end - start
    length = float(np.linalg.norm(along))
    z = along / length if length > 1e-12 else np.array([0.0, 0.0, 1.0])
    x = cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    X = transform((start + end) / 2, np.column_stack([x, cross(z, x), z]))
    return Shape("capsule", X, np.array([radius, length / 2, 0.0]), color, flat=True)


def wire_box(X_world_box: Matrix, half: ArrayLike, radius: float, color: Color) -> list[Shape]:
    """Return the 12 edges of a box as lines."""
    half = np.asarray(half, float)
    edges: list[Shape] = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for signs in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            start = np.zeros(3)
            start[others] = np.array(signs) * half[others]
            end = start.copy()
            start[axis], end[axis] = -half[axis], half[axis]
            p, q = (X_world_box[:3, :3] @ point + X_world_box[:3, 3] for point in (start, end))
            edges.append(segment(p, q, radius, color))
    return edges


def convex_body(vertices: ArrayLike, X_world_body: Matrix, color: Color) -> Shape:
    """Return the convex hull of points (n, 3), m, in the body's frame, with one facet per plane."""
    points = np.asarray(vertices, float)
    hull = convex_hull(points)
    if hull is None:
        raise ValueError(f"{len(points)} points that span no volume are no convex body")
    normals = np.column_stack([hull.normals, hull.offsets])
    _, first = np.unique(np.round(normals, 6) + 0.0, axis=0, return_index=True)
    return Shape("convex", X_world_body, np.abs(points).max(0), color, planes=normals[np.sort(first)])
