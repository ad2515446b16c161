"""One interface to the distances of many box pairs in one call, in either norm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from preshape.control.distance_l1 import WORK_L1, pair_l1
from preshape.control.distance_l2 import WORK_L2, pair_l2
from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix
from preshape.hal.world import OrientedBox

Norm = Literal["l1", "l2"]
NORMS: tuple[Norm, ...] = ("l1", "l2")


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Boxes in the world: centres p (n, 3), axes R (n, 3, 3) as columns, half edges h (n, 3); m."""

    p: Matrix
    R: Matrix
    h: Matrix

    @staticmethod
    def of(boxes: Sequence[OrientedBox]) -> Boxes:
        """Return the arrays of a sequence of boxes."""
        X = np.array([box.X_world_box for box in boxes]).reshape(-1, 4, 4)
        h = np.array([box.half for box in boxes], dtype=np.float64).reshape(-1, 3)
        return Boxes(np.ascontiguousarray(X[:, :3, 3]), np.ascontiguousarray(X[:, :3, :3]), h)


@dataclass(frozen=True, slots=True, eq=False)
class PairDistances:
    """Results for m pairs, written in place: every vector in the world frame, m.

    `distance` (m,) is signed: minus the penetration depth when the boxes overlap. `p_link`, `p_obstacle`
    (m, 3) are the witnesses and `separation` their difference. `gradient` (m, 3) is the derivative of the
    distance by the link's translation, the exit direction when they overlap; moving an overlapping link by
    -separation just separates the two. In L2 the gradient is the unit separation, in L1 they differ.
    """

    distance: Matrix
    p_link: Matrix
    p_obstacle: Matrix
    separation: Matrix
    gradient: Matrix

    @staticmethod
    def empty(pairs: int) -> PairDistances:
        """Return room for a number of pairs."""
        return PairDistances(np.zeros(pairs), *(np.zeros((pairs, 3)) for _ in range(4)))


@compiled
def relative_box(p: Matrix, R: Matrix, p_obstacle: Matrix, R_obstacle: Matrix, y: Matrix, R_rel: Matrix) -> None:
    """Write a link box's centre y and axes R_rel in an obstacle's frame."""
    for i in range(3):
        y[i] = 0.0
        for k in range(3):
            y[i] += R_obstacle[k, i] * (p[k] - p_obstacle[k])
        for j in range(3):
            R_rel[i, j] = R_obstacle[0, i] * R[0, j] + R_obstacle[1, i] * R[1, j] + R_obstacle[2, i] * R[2, j]


@compiled
def rotated(R: Matrix, v: Matrix, out: Matrix) -> None:
    """Write R v."""
    for i in range(3):
        out[i] = R[i, 0] * v[0] + R[i, 1] * v[1] + R[i, 2] * v[2]


@compiled
def _all_pairs(
    euclidean: bool,
    p: Matrix,
    R: Matrix,
    h: Matrix,
    P: Matrix,
    Q: Matrix,
    H: Matrix,
    pairs: NDArray[np.int64],
    distance: Matrix,
    p_link: Matrix,
    p_obstacle: Matrix,
    separation: Matrix,
    gradient: Matrix,
) -> None:
    work1, work2 = np.empty(WORK_L1), np.empty(WORK_L2)
    y, d, a, o, R_rel = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    for n in range(pairs.shape[0]):
        i, j = pairs[n, 0], pairs[n, 1]
        relative_box(p[i], R[i], P[j], Q[j], y, R_rel)
        if euclidean:
            distance[n] = pair_l2(y, R_rel, h[i], H[j], np.inf, a, o, d, work2)
        else:
            distance[n] = pair_l1(y, R_rel, h[i], H[j], a, o, d, work1)
        rotated(Q[j], a, p_link[n])
        rotated(Q[j], o, p_obstacle[n])
        rotated(Q[j], d, gradient[n])
        for k in range(3):
            p_link[n, k] += P[j, k]
            p_obstacle[n, k] += P[j, k]
            separation[n, k] = p_link[n, k] - p_obstacle[n, k]


def pair_distances(norm: Norm, links: Boxes, obstacles: Boxes, pairs: NDArray[np.int64], out: PairDistances) -> None:
    """Write the signed distances of all pairs (m, 2) of (link, obstacle) indices into `out`, in one compiled call.

    The L1 norm is that of the obstacle's frame. `ValueError` names an unknown norm or a wrong size of `out`.
    """
    if norm not in NORMS:
        raise ValueError(f"norm: got {norm!r}, allowed are {', '.join(NORMS)}")
    if out.distance.shape != (len(pairs),):
        raise ValueError(f"out: got room for {len(out.distance)} pairs, needed is {len(pairs)}")
    _all_pairs(
        norm == "l2", links.p, links.R, links.h, obstacles.p, obstacles.R, obstacles.h, pairs,
        out.distance, out.p_link, out.p_obstacle, out.separation, out.gradient,
    )  # fmt: skip
