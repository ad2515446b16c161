"""A small dense QP with bounds: min 1/2 x'G x + g'x, lower <= x <= upper, by a primal active set."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix


@compiled
def _solve_free(G: Matrix, r: Matrix, free: NDArray[np.int64], n: int, L: Matrix, y: Matrix) -> bool:
    """Write y = -G_ff^-1 r_f over the first n indices in `free`, by Cholesky; False if G_ff is not positive."""
    for i in range(n):
        for j in range(i + 1):
            s = G[free[i], free[j]]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                if s <= 1e-12 * (1.0 + G[free[i], free[i]]):
                    return False
                L[i, i] = np.sqrt(s)
            else:
                L[i, j] = s / L[j, j]
    for i in range(n):
        s = -r[free[i]]
        for k in range(i):
            s -= L[i, k] * y[k]
        y[i] = s / L[i, i]
    for i in range(n - 1, -1, -1):
        s = y[i]
        for k in range(i + 1, n):
            s -= L[k, i] * y[k]
        y[i] = s / L[i, i]
    return True


@compiled
def solve_bounded_qp(G: Matrix, g: Matrix, lower: Matrix, upper: Matrix, x: Matrix) -> int:
    """Minimise 1/2 x'G x + g'x over lower <= x <= upper, from the feasible x, which receives the answer.

    Every step solves for the free components, goes to the first bound in the way and holds it there; at the
    minimum over the free ones the bound with the largest gradient against it is let go. The value falls with
    every step, so no set of bounds is met twice.

    Returns:
        1 solved, 0 no end after 8 n steps, -1 G is not positive definite on the free components.
    """
    n = g.shape[0]
    held = np.zeros(n, np.int64)
    free = np.empty(n, np.int64)
    r, y, L = np.empty(n), np.empty(n), np.empty((n, n))
    for i in range(n):
        if upper[i] <= lower[i]:
            x[i] = lower[i]
            held[i] = 2
    scale = 1.0 + np.abs(g).max()
    for _ in range(8 * n):
        m = 0
        for i in range(n):
            s = g[i]
            for k in range(n):
                s += G[i, k] * x[k]
            r[i] = s
            if held[i] == 0:
                free[m] = i
                m += 1
        if not _solve_free(G, r, free, m, L, y):
            return -1
        step, stop, side = 1.0, -1, 0
        for j in range(m):
            i = free[j]
            if y[j] < 0.0 and x[i] + y[j] < lower[i]:
                t = (lower[i] - x[i]) / y[j]
                if t < step:
                    step, stop, side = t, i, -1
            elif y[j] > 0.0 and x[i] + y[j] > upper[i]:
                t = (upper[i] - x[i]) / y[j]
                if t < step:
                    step, stop, side = t, i, 1
        for j in range(m):
            x[free[j]] += step * y[j]
        if stop >= 0:
            x[stop] = lower[stop] if side < 0 else upper[stop]
            held[stop] = side
            continue
        worst, out = 1e-10 * scale, -1
        for i in range(n):
            if held[i] == 1 or held[i] == -1:
                s = g[i]
                for k in range(n):
                    s += G[i, k] * x[k]
                if s * held[i] > worst:
                    worst, out = s * held[i], i
        if out < 0:
            return 1
        held[out] = 0
    return 0
