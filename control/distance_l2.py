"""Exact Euclidean distance of two boxes: separating axes for the lower bound, features for the witnesses.

For a unit n the gap s(n) = |y.n| - sum_j |g_j.n| bounds the distance from below (y, g_j as in `distance_l1`).
The closest features of two boxes are a corner and a box, or two edges. Two edges are closest inside both
only if n is their cross product and D = s(n), so only the axis with the largest gap can be such a pair.
All the rest are corner-to-box projections, exact by clamping: witnesses cannot leave their boxes.
Overlapping boxes: the depth is -max s(n) over the 15 normals of the Minkowski difference's facets.
"""

from __future__ import annotations

import numpy as np

from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix

TIE_M = 1e-14
"""Feature pairs whose distances differ by less than this are averaged, m."""
_PARALLEL = 1e-16
_EDGE_AXIS = 3
WORK_L2 = (6, 3)
"""Shape of the scratch array that `pair_l2` needs."""


@compiled
def _gap(y: Matrix, R: Matrix, h: Matrix, H: Matrix, n0: float, n1: float, n2: float) -> float:
    gap = abs(y[0] * n0 + y[1] * n1 + y[2] * n2) - H[0] * abs(n0) - H[1] * abs(n1) - H[2] * abs(n2)
    for j in range(3):
        gap -= h[j] * abs(R[0, j] * n0 + R[1, j] * n1 + R[2, j] * n2)
    return gap


@compiled
def _edge_normal(R: Matrix, i: int, k: int, n: Matrix) -> bool:
    """Write the unit e_k x R[:, i]; return False when the two edges are parallel."""
    u, v = (k + 1) % 3, (k + 2) % 3
    square = R[u, i] ** 2 + R[v, i] ** 2
    if square < _PARALLEL:
        return False
    scale = 1.0 / np.sqrt(square)
    n[k], n[u], n[v] = 0.0, -R[v, i] * scale, R[u, i] * scale
    return True


@compiled
def _largest_gap(y: Matrix, R: Matrix, h: Matrix, H: Matrix, n: Matrix, trial: Matrix) -> tuple[float, bool]:
    """Write the axis with the largest gap; return the gap and whether it belongs to a pair of edges."""
    gap, edges = -np.inf, False
    for k in range(3):
        value = abs(y[k]) - H[k] - h[0] * abs(R[k, 0]) - h[1] * abs(R[k, 1]) - h[2] * abs(R[k, 2])
        if value > gap:
            gap = value
            n[0], n[1], n[2] = 0.0, 0.0, 0.0
            n[k] = 1.0
    for j in range(3):
        along = y[0] * R[0, j] + y[1] * R[1, j] + y[2] * R[2, j]
        value = abs(along) - h[j] - H[0] * abs(R[0, j]) - H[1] * abs(R[1, j]) - H[2] * abs(R[2, j])
        if value > gap + TIE_M:
            gap = value
            n[0], n[1], n[2] = R[0, j], R[1, j], R[2, j]
    for i in range(3):
        for k in range(3):
            if _edge_normal(R, i, k, trial):
                value = _gap(y, R, h, H, trial[0], trial[1], trial[2])
                if value > gap + TIE_M:
                    gap, edges = value, True
                    n[0], n[1], n[2] = trial[0], trial[1], trial[2]
    if y[0] * n[0] + y[1] * n[1] + y[2] * n[2] < 0.0:
        n[0], n[1], n[2] = -n[0], -n[1], -n[2]
    return gap, edges


@compiled
def _keep(
    best: float, count: float, ax: float, ay: float, az: float, ox: float, oy: float, oz: float, sums: Matrix
) -> tuple[float, float]:
    """Keep the closest witnesses (rows 0 and 1: sums over ties); return the distance and the number of ties."""
    value = np.sqrt((ax - ox) ** 2 + (ay - oy) ** 2 + (az - oz) ** 2)
    if value > best + TIE_M:
        return best, count
    if value < best - TIE_M:
        best, count = value, 0.0
        sums[0, :] = 0.0
        sums[1, :] = 0.0
    sums[0, 0] += ax
    sums[0, 1] += ay
    sums[0, 2] += az
    sums[1, 0] += ox
    sums[1, 1] += oy
    sums[1, 2] += oz
    return best, count + 1.0


@compiled
def _clamp(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)


@compiled
def _corners(y: Matrix, R: Matrix, h: Matrix, H: Matrix, sums: Matrix) -> tuple[float, float]:
    """Project the corners of each box onto the other."""
    best, count = np.inf, 0.0
    for corner in range(8):
        s0 = h[0] if corner & 1 else -h[0]
        s1 = h[1] if corner & 2 else -h[1]
        s2 = h[2] if corner & 4 else -h[2]
        ax = y[0] + R[0, 0] * s0 + R[0, 1] * s1 + R[0, 2] * s2
        ay = y[1] + R[1, 0] * s0 + R[1, 1] * s1 + R[1, 2] * s2
        az = y[2] + R[2, 0] * s0 + R[2, 1] * s1 + R[2, 2] * s2
        best, count = _keep(best, count, ax, ay, az, _clamp(ax, H[0]), _clamp(ay, H[1]), _clamp(az, H[2]), sums)
    for corner in range(8):
        ox = H[0] if corner & 1 else -H[0]
        oy = H[1] if corner & 2 else -H[1]
        oz = H[2] if corner & 4 else -H[2]
        rx, ry, rz = ox - y[0], oy - y[1], oz - y[2]
        s0 = _clamp(R[0, 0] * rx + R[1, 0] * ry + R[2, 0] * rz, h[0])
        s1 = _clamp(R[0, 1] * rx + R[1, 1] * ry + R[2, 1] * rz, h[1])
        s2 = _clamp(R[0, 2] * rx + R[1, 2] * ry + R[2, 2] * rz, h[2])
        ax = y[0] + R[0, 0] * s0 + R[0, 1] * s1 + R[0, 2] * s2
        ay = y[1] + R[1, 0] * s0 + R[1, 1] * s1 + R[1, 2] * s2
        az = y[2] + R[2, 0] * s0 + R[2, 1] * s1 + R[2, 2] * s2
        best, count = _keep(best, count, ax, ay, az, ox, oy, oz, sums)
    return best, count


@compiled
def _edge_pair(
    y: Matrix, R: Matrix, h: Matrix, H: Matrix, i: int, k: int, n: Matrix, signs: int,
    best: float, count: float, sums: Matrix,
) -> tuple[float, float]:  # fmt: skip
    """Try one edge of the link along i and one of the obstacle along k, those that support n.

    An edge whose side is undecided (n lies in a face's normal plane) is taken by the bits of `signs`.
    """
    p, o, bit = sums[2], sums[3], 1
    for a in range(3):
        p[a], o[a] = y[a], 0.0
    for j in range(3):
        if j != i:
            along = R[0, j] * n[0] + R[1, j] * n[1] + R[2, j] * n[2]
            side = -1.0 if along > 0.0 else 1.0
            if abs(along) < 1e-9:
                side = 1.0 if signs & bit else -1.0
            for a in range(3):
                p[a] += side * h[j] * R[a, j]
            bit *= 2
    for j in range(3):
        if j != k:
            side = 1.0 if n[j] > 0.0 else -1.0
            if abs(n[j]) < 1e-9:
                side = 1.0 if signs & bit else -1.0
            o[j] = side * H[j]
            bit *= 2
    w0, w1, w2 = p[0] - o[0], p[1] - o[1], p[2] - o[2]
    wk = p[k] - o[k]
    b = R[k, i]
    sine2 = R[(k + 1) % 3, i] ** 2 + R[(k + 2) % 3, i] ** 2
    u = _clamp((b * wk - (w0 * R[0, i] + w1 * R[1, i] + w2 * R[2, i])) / sine2, h[i])
    o[k] = _clamp(wk + u * b + o[k], H[k])
    return _keep(best, count, p[0] + u * R[0, i], p[1] + u * R[1, i], p[2] + u * R[2, i], o[0], o[1], o[2], sums)


@compiled
def _undecided(R: Matrix, i: int, k: int, n: Matrix) -> int:
    """Return the mask of `signs` bits that `_edge_pair` would use."""
    mask, bit = 0, 1
    for j in range(3):
        if j != i:
            if abs(R[0, j] * n[0] + R[1, j] * n[1] + R[2, j] * n[2]) < 1e-9:
                mask |= bit
            bit *= 2
    for j in range(3):
        if j != k:
            if abs(n[j]) < 1e-9:
                mask |= bit
            bit *= 2
    return mask


@compiled
def _edges(
    y: Matrix, R: Matrix, h: Matrix, H: Matrix, gap: float, best: float, count: float, sums: Matrix
) -> tuple[float, float]:
    """Try the pairs of edges whose cross product has the largest gap."""
    n = sums[4]
    for i in range(3):
        for k in range(3):
            if not _edge_normal(R, i, k, n):
                continue
            if _gap(y, R, h, H, n[0], n[1], n[2]) < gap - 1e-10:
                continue
            if y[0] * n[0] + y[1] * n[1] + y[2] * n[2] < 0.0:
                n[0], n[1], n[2] = -n[0], -n[1], -n[2]
            mask = _undecided(R, i, k, n)
            for signs in range(16):
                if signs & ~mask == 0:
                    best, count = _edge_pair(y, R, h, H, i, k, n, signs, best, count, sums)
    return best, count


@compiled
def pair_l2(
    y: Matrix, R: Matrix, h: Matrix, H: Matrix, cutoff: float, a: Matrix, o: Matrix, d: Matrix, work: Matrix
) -> float:
    """Return the signed Euclidean distance (m) of a link box from an obstacle box, all in the obstacle's frame.

    Args:
        y: centre of the link box (3,), m.
        R: axes of the link box as columns (3, 3).
        h: half edges of the link box (3,), m.
        H: half edges of the obstacle (3,), m.
        cutoff: a pair farther apart returns a lower bound > cutoff and no witnesses, m.
        a: receives the witness on the link (3,), m.
        o: receives the witness on the obstacle (3,), m.
        d: receives the unit gradient dD/dy (3,): the exit direction when D < 0.
        work: scratch of shape `WORK_L2`.
    """
    gap, _ = _largest_gap(y, R, h, H, d, work[5])
    if gap > cutoff:
        return gap
    shift = 0.0
    if gap <= 0.0:
        shift = -gap
        for k in range(3):
            y[k] += shift * d[k]
    target = gap + shift
    best, count = _corners(y, R, h, H, work)
    if best > target + TIE_M:
        best, count = _edges(y, R, h, H, target, best, count, work)
    for k in range(3):
        a[k] = work[0, k] / count
        o[k] = work[1, k] / count
    if gap > 0.0:
        if best > gap + 1e-12 and best > 1e-9:
            for k in range(3):
                d[k] = (a[k] - o[k]) / best
        return best
    for k in range(3):
        y[k] -= shift * d[k]
        a[k] -= shift * d[k]
    return gap
