"""The grasping plane of section III-D: the frame that the fingertips of a grasp span."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.layout import Side
from preshape.hal.transform import Matrix, cross, transform


def _toward(direction: Matrix, reference: Matrix) -> Matrix:
    """Return the unit vector along a line, pointing to the same side as the reference."""
    unit = direction / np.linalg.norm(direction)
    return unit if unit @ reference >= 0 else -unit


def grasping_plane(tips: ArrayLike, side: Side, lateral: ArrayLike = (0.0, 1.0, 0.0)) -> Matrix:
    """Return X_world_gp of fingertips (n, 3), thumb first, then fore, middle, ring as far as used (n = 2, 3, 4).

    Position: midway between the thumb's tip and the centre of the others. x: normal of the others' triangle, or
    the direction square to their segment through the thumb's tip, or (one finger) from it to the thumb; towards
    the thumb. y: from the ring's (last finger's) tip to the fore's, made square to x; on the left hand the other
    way round, so that z = x cross y points from the palm to the object on both. `lateral` takes the place of
    that direction when a single finger meets the thumb, in the tips' frame.

    Raises:
        ValueError: fewer than 2 or more than 4 tips, or tips that span no frame (coinciding, or the thumb in line).
    """
    p = np.asarray(tips, float)
    if p.ndim != 2 or p.shape[1] != 3 or not 2 <= len(p) <= 4:
        raise ValueError(f"a grasping plane needs 2 to 4 fingertips, got an array of shape {p.shape}")
    others, center = p[1:], p[1:].mean(axis=0)
    to_thumb = p[0] - center
    across = np.asarray(lateral, float) if len(others) == 1 else others[0] - others[-1]
    if len(others) > 1 and side == "left":
        across = -across
    if np.linalg.norm(to_thumb) < 1e-9 or np.linalg.norm(across) < 1e-9:
        raise ValueError(f"fingertips coincide: {p.tolist()}")
    if len(others) == 3:
        normal = cross(others[1] - others[0], others[2] - others[0])
        # A flat triangle has no normal: its longest side stands for it.
        flat = np.linalg.norm(normal) < 1e-9
        x = to_thumb - across * (to_thumb @ across) / (across @ across) if flat else normal
    elif len(others) == 2:
        x = to_thumb - across * (to_thumb @ across) / (across @ across)
    else:
        x = to_thumb
    if np.linalg.norm(x) < 1e-9:
        raise ValueError(f"the thumb lies in line with the other fingertips: {p.tolist()}")
    x = _toward(x, to_thumb)
    y = across - x * (x @ across)
    if np.linalg.norm(y) < 1e-9:
        raise ValueError(f"the lateral direction is along the grasp: {p.tolist()}")
    y /= np.linalg.norm(y)
    return transform((p[0] + center) / 2.0, np.column_stack([x, y, cross(x, y)]))
