"""Distances of capsules to capsules and to boxes, compiled: the coarse shapes that arm paths are checked with.

A capsule is a segment and a radius; its distance to another capsule is that of the segments less both
radii, to a box that of the segment less its radius. All in m; negative when they overlap.
"""

from __future__ import annotations

import numpy as np

from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix

BOX_SEARCH_STEPS = 28
"""Golden-section steps along a segment: 0.618^28 of its length, well below a micrometre on an arm."""

_GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0


@compiled
def _unit_clamp(value: float) -> float:
    return min(1.0, max(0.0, value))


@compiled
def segment_distance(a0: Matrix, a1: Matrix, b0: Matrix, b1: Matrix) -> float:
    """Return the least distance of two segments, (3,) end points each (Ericson 2005, 5.1.9); may be points."""
    aa = ab = bb = ar = br = 0.0
    for i in range(3):
        u, v, r = a1[i] - a0[i], b1[i] - b0[i], a0[i] - b0[i]
        aa += u * u
        ab += u * v
        bb += v * v
        ar += u * r
        br += v * r
    determinant = aa * bb - ab * ab
    s = _unit_clamp((ab * br - ar * bb) / determinant) if determinant > 1e-12 * aa * bb else 0.0
    t = (ab * s + br) / bb if bb > 0.0 else 0.0
    if t < 0.0 or t > 1.0 or bb == 0.0:
        t = _unit_clamp(t)
        s = _unit_clamp((ab * t - ar) / aa) if aa > 0.0 else 0.0
    total = 0.0
    for i in range(3):
        gap = a0[i] + s * (a1[i] - a0[i]) - b0[i] - t * (b1[i] - b0[i])
        total += gap * gap
    return np.sqrt(total)


@compiled
def point_box_distance(p: Matrix, half: Matrix) -> float:
    """Return the signed distance of a point, in the box's frame, to a box of half edges `half` (3,)."""
    outside, deepest = 0.0, -np.inf
    for i in range(3):
        gap = abs(p[i]) - half[i]
        deepest = max(deepest, gap)
        if gap > 0.0:
            outside += gap * gap
    return np.sqrt(outside) if outside > 0.0 else deepest


@compiled
def segment_box_distance(p0: Matrix, p1: Matrix, X_world_box: Matrix, half: Matrix) -> float:
    """Return the least signed distance along a segment to a box: convex along it, so by golden section."""
    a, d, p = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        a[i] = d[i] = 0.0
        for j in range(3):
            a[i] += X_world_box[j, i] * (p0[j] - X_world_box[j, 3])
            d[i] += X_world_box[j, i] * (p1[j] - p0[j])
    low, high = 0.0, 1.0
    x = [high - _GOLDEN, _GOLDEN]
    f = [0.0, 0.0]
    for k in range(2):
        for i in range(3):
            p[i] = a[i] + x[k] * d[i]
        f[k] = point_box_distance(p, half)
    best = min(f[0], f[1])
    for _ in range(BOX_SEARCH_STEPS):
        side = 0 if f[0] < f[1] else 1
        if side == 0:
            high, x[1], f[1] = x[1], x[0], f[0]
            x[0] = high - _GOLDEN * (high - low)
        else:
            low, x[0], f[0] = x[0], x[1], f[1]
            x[1] = low + _GOLDEN * (high - low)
        for i in range(3):
            p[i] = a[i] + x[side] * d[i]
        f[side] = point_box_distance(p, half)
        best = min(best, f[side])
    # The least value may lie at an end, which golden section only approaches.
    for i in range(3):
        p[i] = a[i] + d[i]
    return min(best, min(point_box_distance(a, half), point_box_distance(p, half)))
