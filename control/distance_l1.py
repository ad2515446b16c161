"""Exact L1 distance of two boxes in the obstacle's frame, by the vertices of the dual problem.

With y = c_link - c_obstacle and the six generators g_j (half edges times axes of both boxes),

    D = min_s |y + sum_j s_j g_j|_1,  |s_j| <= 1      (the paper's linear programme)
      = max_d  y.d - sum_j |g_j.d|,   |d|_max <= 1    (its dual)

The dual is concave and linear in every cell of the planes g_j.d = 0, so its maximum lies at a corner of
the cube, where a cube edge meets a plane, or along a cross product of two generators: 55 points up to
sign. The obstacle's own planes are d_k = 0, hence 12 of these coincide or do not exist and 43 are
evaluated. The maximum over the cube's *surface* is minus the penetration depth when it is negative.
"""

from __future__ import annotations

import numpy as np

from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix

TIE_M = 1e-14
"""Dual values closer than this are one value, m."""
_ZERO = 1e-9
_SLACK_M = 1e-11
WORK_L1 = (6, 48)
"""Shape of the scratch array that `pair_l1` needs."""


@compiled
def _candidates(R: Matrix, D: Matrix) -> int:
    """Write the dual vectors as columns of D (3, 43), each |d|_max <= 1; return their number."""
    n = 0
    for k in range(3):
        u, v = (k + 1) % 3, (k + 2) % 3
        D[k, n], D[u, n], D[v, n] = 1.0, 0.0, 0.0
        scale = 1.0 / max(abs(R[0, k]), abs(R[1, k]), abs(R[2, k]))
        D[0, n + 1], D[1, n + 1], D[2, n + 1] = R[0, k] * scale, R[1, k] * scale, R[2, k] * scale
        D[k, n + 2], D[u, n + 2], D[v, n + 2] = 0.0, 1.0, 1.0
        D[k, n + 3], D[u, n + 3], D[v, n + 3] = 0.0, 1.0, -1.0
        n += 4
        for j in range(3):
            along, across, beside = R[k, j], R[u, j], R[v, j]
            largest = max(abs(across), abs(beside))
            if largest > 1e-12:
                D[k, n], D[u, n], D[v, n] = 0.0, -beside / largest, across / largest
                n += 1
            for side in range(2):
                other = 1.0 - 2.0 * side
                rest = across + other * beside
                if abs(rest) <= abs(along) and abs(along) > 1e-12:
                    D[k, n], D[u, n], D[v, n] = -rest / along, 1.0, other
                    n += 1
    for corner in range(4):
        D[0, n], D[1, n], D[2, n] = 1.0, 1.0 - 2.0 * (corner & 1), 1.0 - (corner & 2)
        n += 1
    return n


@compiled
def _dual_values(y: Matrix, R: Matrix, h: Matrix, H: Matrix, D: Matrix, count: int, value: Matrix) -> float:
    """Write |y.d| - sum_j |g_j.d| of the first `count` columns of D; return the largest."""
    y0, y1, y2, H0, H1, H2 = y[0], y[1], y[2], H[0], H[1], H[2]
    a0, a1, a2 = R[0, 0] * h[0], R[1, 0] * h[0], R[2, 0] * h[0]
    b0, b1, b2 = R[0, 1] * h[1], R[1, 1] * h[1], R[2, 1] * h[1]
    c0, c1, c2 = R[0, 2] * h[2], R[1, 2] * h[2], R[2, 2] * h[2]
    for n in range(count):
        d0, d1, d2 = D[0, n], D[1, n], D[2, n]
        value[n] = (
            abs(y0 * d0 + y1 * d1 + y2 * d2)
            - (H0 * abs(d0) + H1 * abs(d1) + H2 * abs(d2))
            - abs(a0 * d0 + a1 * d1 + a2 * d2)
            - abs(b0 * d0 + b1 * d1 + b2 * d2)
            - abs(c0 * d0 + c1 * d1 + c2 * d2)
        )
    best = value[0]
    for n in range(1, count):
        best = max(best, value[n])
    return best


@compiled
def _dual(y: Matrix, D: Matrix, count: int, value: Matrix, best: float, d: Matrix) -> None:
    """Write the best dual vector, signed along y: the mean of the ties when apart, the first when overlapping."""
    ties = 0.0
    d[0] = d[1] = d[2] = 0.0
    for n in range(count):
        if value[n] >= best - TIE_M:
            sign = -1.0 if y[0] * D[0, n] + y[1] * D[1, n] + y[2] * D[2, n] < 0.0 else 1.0
            ties += 1.0
            for k in range(3):
                d[k] += sign * D[k, n]
            if best <= 0.0:
                break
    for k in range(3):
        d[k] /= ties


@compiled
def _bounds(d: float, H: float) -> tuple[float, float]:
    """Return where the link's witness may lie along one axis, given the dual d there (complementary slackness)."""
    if abs(d) <= _ZERO:
        return -H, H
    if abs(d) >= 1.0 - _ZERO:
        return (H, np.inf) if d > 0.0 else (-np.inf, -H)
    return (H, H) if d > 0.0 else (-H, -H)


@compiled
def _clip(polygon: Matrix, count: int, clipped: Matrix, a: float, b: float, c: float) -> int:
    """Write the part of a convex polygon with a x + b y <= c; return its number of corners."""
    kept = 0
    for i in range(count):
        n = (i + 1) % count
        here = a * polygon[i, 0] + b * polygon[i, 1] - c
        there = a * polygon[n, 0] + b * polygon[n, 1] - c
        if here <= 0.0:
            clipped[kept, 0], clipped[kept, 1] = polygon[i, 0], polygon[i, 1]
            kept += 1
        if (here < 0.0 < there) or (there < 0.0 < here):
            t = here / (here - there)
            clipped[kept, 0] = polygon[i, 0] + t * (polygon[n, 0] - polygon[i, 0])
            clipped[kept, 1] = polygon[i, 1] + t * (polygon[n, 1] - polygon[i, 1])
            kept += 1
    return kept


@compiled
def _polygon_center(
    a: Matrix, R: Matrix, h: Matrix, d: Matrix, H: Matrix, i: int, j: int, work: Matrix
) -> tuple[float, float]:
    """Return the mean corner of the optimal (s_i, s_j), the square clipped by the bounds of all three axes."""
    slack = _SLACK_M
    while True:
        here, there = work[0].reshape(24, 2), work[1].reshape(24, 2)
        here[0, 0], here[0, 1], here[1, 0], here[1, 1] = -1.0, -1.0, 1.0, -1.0
        here[2, 0], here[2, 1], here[3, 0], here[3, 1] = 1.0, 1.0, -1.0, 1.0
        count = 4
        for k in range(3):
            gi, gj = R[k, i] * h[i], R[k, j] * h[j]
            low, high = _bounds(d[k], H[k])
            if high < np.inf and count > 0:
                count = _clip(here, count, there, gi, gj, high - a[k] + slack)
                here, there = there, here
            if low > -np.inf and count > 0:
                count = _clip(here, count, there, -gi, -gj, a[k] - low + slack)
                here, there = there, here
        if count > 0 or slack > 1e-3:
            break
        slack *= 10.0
    si = sj = 0.0
    for n in range(count):
        si += here[n, 0] / count
        sj += here[n, 1] / count
    return si, sj


@compiled
def _interval_center(a: Matrix, R: Matrix, h: Matrix, d: Matrix, H: Matrix, j: int) -> float:
    """Return the middle of the optimal s_j."""
    first, last = -1.0, 1.0
    for k in range(3):
        g = R[k, j] * h[j]
        if abs(g) > 1e-15:
            low, high = _bounds(d[k], H[k])
            from_low, from_high = (low - a[k]) / g, (high - a[k]) / g
            first = max(first, min(from_low, from_high))
            last = min(last, max(from_low, from_high))
    return min(max(0.5 * (first + last), -1.0), 1.0)


@compiled
def _witness(y: Matrix, R: Matrix, h: Matrix, H: Matrix, d: Matrix, a: Matrix, work: Matrix) -> None:
    """Write a point a of the link that attains the distance: any point in complementary slackness with d is optimal."""
    a[0], a[1], a[2] = y[0], y[1], y[2]
    free_i = free_j = -1
    for j in range(3):
        along = R[0, j] * d[0] + R[1, j] * d[1] + R[2, j] * d[2]
        if abs(along) > _ZERO:
            s = -h[j] if along > 0.0 else h[j]
            for k in range(3):
                a[k] += s * R[k, j]
        elif free_i < 0:
            free_i = j
        else:
            free_j = j
    if free_i >= 0 and free_j >= 0:
        si, sj = _polygon_center(a, R, h, d, H, free_i, free_j, work)
        for k in range(3):
            a[k] += si * h[free_i] * R[k, free_i] + sj * h[free_j] * R[k, free_j]
    elif free_i >= 0:
        s = _interval_center(a, R, h, d, H, free_i) * h[free_i]
        for k in range(3):
            a[k] += s * R[k, free_i]


@compiled
def pair_l1(y: Matrix, R: Matrix, h: Matrix, H: Matrix, a: Matrix, o: Matrix, d: Matrix, work: Matrix) -> float:
    """Return the signed L1 distance (m) of a link box from an obstacle box, all in the obstacle's frame.

    Args:
        y: centre of the link box (3,), m.
        R: axes of the link box as columns (3, 3).
        h: half edges of the link box (3,), m.
        H: half edges of the obstacle (3,), m.
        a: receives the witness on the link (3,), m.
        o: receives the witness on the obstacle (3,), m.
        d: receives the dual gradient dD/dy (3,), |d|_max = 1: the exit direction when D < 0.
        work: scratch of shape `WORK_L1`.

    Overlapping boxes: D = -depth; moving the link by o - a, one axis of the obstacle, just separates them.
    """
    D, values = work[2:5], work[5]
    count = _candidates(R, D)
    value = _dual_values(y, R, h, H, D, count, values)
    _dual(y, D, count, values, value, d)
    if value > 0.0:
        _witness(y, R, h, H, d, a, work)
        for k in range(3):
            o[k] = min(max(a[k], -H[k]), H[k])
        return value
    axis = 0
    for k in range(3):
        if abs(d[k]) > abs(d[axis]) + _ZERO:
            axis = k
    shift = -value if d[axis] > 0.0 else value
    y[axis] += shift
    _witness(y, R, h, H, d, a, work)
    y[axis] -= shift
    for k in range(3):
        o[k] = min(max(a[k], -H[k]), H[k])
    a[axis] -= shift
    return value
