"""How much of a face a hand hides from the camera: sight lines against the hand's capsules."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from preshape.hal.compiled import compiled
from preshape.hal.layout import Side
from preshape.hal.transform import Matrix
from preshape.planner.arm_capsules import hand_capsules
from preshape.planner.capsule_distance import segment_distance

SAMPLES = 6
"""Points along each edge of the rectangle looked at."""


@compiled
def _count_hidden(eye: Matrix, points: Matrix, starts: Matrix, ends: Matrix, radii: Matrix) -> int:
    hidden = 0
    for n in range(points.shape[0]):
        for c in range(radii.shape[0]):
            if segment_distance(eye, points[n], starts[c], ends[c]) < radii[c]:
                hidden += 1
                break
    return hidden


@lru_cache(maxsize=256)
def _capsules(side: Side, joints: bytes) -> tuple[Matrix, Matrix, Matrix]:
    capsules = hand_capsules(side, np.frombuffer(joints))
    starts, ends = np.array([c.start for c in capsules]), np.array([c.end for c in capsules])
    return starts, ends, np.array([c.radius for c in capsules], dtype=float)


def rectangle_points(lower: Matrix, upper: Matrix) -> Matrix:
    """Return `SAMPLES`^2 points (n, 3) spread over a rectangle given by corners (3,) that agree in one coordinate."""
    shares = (np.arange(SAMPLES) + 0.5) / SAMPLES
    axes = [lower[k : k + 1] if lower[k] == upper[k] else lower[k] + shares * (upper[k] - lower[k]) for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def hidden_share(p_eye: Matrix, points: Matrix, side: Side, X_world_palm: Matrix, joints: Matrix) -> float:
    """Return the share of points (n, 3), m, that a hand (13 joints, rad) hides from an eye; all in the world."""
    starts, ends, radii = _capsules(side, np.ascontiguousarray(joints, dtype=float).tobytes())
    R, p = X_world_palm[:3, :3], X_world_palm[:3, 3]
    hidden = _count_hidden(
        np.ascontiguousarray(p_eye, dtype=float), np.ascontiguousarray(points), starts @ R.T + p, ends @ R.T + p, radii
    )
    return hidden / len(points)
