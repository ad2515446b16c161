"""Clearance of both arms, hands and a held box from each other and from boxes, for any joint angles."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal.compiled import compiled
from preshape.hal.layout import ARM_DOF, SIDES, Side
from preshape.hal.transform import Matrix
from preshape.hal.world import OrientedBox, Workcell
from preshape.planner.arm_capsules import (
    HeldBox,
    box_pairs,
    capsule_pairs,
    edge_capsules,
    frame_index,
    robot_capsules,
)
from preshape.planner.arm_kinematics import FRAME_COUNT, chain_frames, link_origins, mount
from preshape.planner.capsule_distance import segment_box_distance, segment_distance

ARMS_DOF = ARM_DOF * len(SIDES)


class _Tables(NamedTuple):
    """The model as arrays for compiled code."""

    origins: Matrix
    bases: Matrix
    mounts: Matrix
    frame: NDArray[np.int64]
    start: Matrix
    end: Matrix
    radius: Matrix
    pairs: NDArray[np.int64]
    X_world_box: Matrix
    half: Matrix
    box_pairs: NDArray[np.int64]
    meeting: NDArray[np.int64]


@compiled
def _place(tables: _Tables, q: Matrix, start: Matrix, end: Matrix) -> None:
    """Write the world end points (n, 3) of all capsules for q (14)."""
    frames = np.empty((2 * FRAME_COUNT, 4, 4))
    for arm in range(2):
        rows = frames[arm * FRAME_COUNT : (arm + 1) * FRAME_COUNT]
        chain_frames(
            tables.origins, tables.bases[arm], tables.mounts[arm], q[arm * ARM_DOF : (arm + 1) * ARM_DOF], rows
        )
    for c in range(tables.frame.shape[0]):
        X = frames[tables.frame[c]]
        for i in range(3):
            start[c, i] = end[c, i] = X[i, 3]
            for j in range(3):
                start[c, i] += X[i, j] * tables.start[c, j]
                end[c, i] += X[i, j] * tables.end[c, j]


@compiled
def _beyond(a0: Matrix, a1: Matrix, center: Matrix, distance: float) -> bool:
    """Return whether a segment's bounding sphere lies farther from a point than a distance."""
    gap = length = 0.0
    for i in range(3):
        gap += (0.5 * (a0[i] + a1[i]) - center[i]) ** 2
        length += (a1[i] - a0[i]) ** 2
    reach = distance + 0.5 * np.sqrt(length)
    return reach < 0.0 or gap > reach * reach


@compiled
def least_slack(tables: _Tables, q: Matrix, margins: Matrix, enough: float, stop_below: float) -> tuple[float, int]:
    """Return (slack, pair) of the pair whose distance is least beyond the margin (meetings,), m, of its two bodies.

    Pairs are counted on from capsule pairs to pairs with boxes. Those with more slack than `enough` (m) are not looked
    at and give (`enough`, -1); the search ends at the first pair that has less than `stop_below`.
    """
    count = tables.frame.shape[0]
    start, end = np.empty((count, 3)), np.empty((count, 3))
    _place(tables, q, start, end)
    best, nearest = enough, -1
    middle = np.empty(3)
    for n in range(tables.pairs.shape[0]):
        i, j = tables.pairs[n, 0], tables.pairs[n, 1]
        radii, margin = float(tables.radius[i] + tables.radius[j]), float(margins[tables.meeting[n]])
        length = 0.0
        for k in range(3):
            middle[k] = 0.5 * (start[j, k] + end[j, k])
            length += (end[j, k] - start[j, k]) ** 2
        if _beyond(start[i], end[i], middle, best + margin + radii + 0.5 * np.sqrt(length)):
            continue
        slack = segment_distance(start[i], end[i], start[j], end[j]) - radii - margin
        if slack < best:
            best, nearest = slack, n
            if best < stop_below:
                return best, nearest
    for n in range(tables.box_pairs.shape[0]):
        i, k = tables.box_pairs[n, 0], tables.box_pairs[n, 1]
        margin = float(margins[tables.meeting[tables.pairs.shape[0] + n]])
        X, half = tables.X_world_box[k], tables.half[k]
        middle[0], middle[1], middle[2] = X[0, 3], X[1, 3], X[2, 3]
        corner = np.sqrt(half[0] ** 2 + half[1] ** 2 + half[2] ** 2)
        if _beyond(start[i], end[i], middle, best + margin + tables.radius[i] + corner):
            continue
        slack = segment_box_distance(start[i], end[i], X, half) - float(tables.radius[i]) - margin
        if slack < best:
            best, nearest = slack, tables.pairs.shape[0] + n
            if best < stop_below:
                return best, nearest
    return best, nearest


@compiled
def edge_keeps(tables: _Tables, q_from: Matrix, q_to: Matrix, margins: Matrix, step: float) -> bool:
    """Return whether all of a straight joint path keeps the margins, sampled at most `step` rad apart (max-norm)."""
    largest = 0.0
    for i in range(q_from.shape[0]):
        largest = max(largest, abs(q_to[i] - q_from[i]))
    count = max(1, int(np.ceil(largest / step)))
    for k in range(count, -1, -1):
        q = q_from + (k / count) * (q_to - q_from)
        if least_slack(tables, q, margins, 0.0, 0.0)[0] < 0.0:
            return False
    return True


@dataclass(frozen=True, slots=True)
class Clearance:
    """The least distance (m, negative when overlapping) and the two bodies it was found between."""

    distance: float
    bodies: tuple[str, str]


FAR = 1.0
"""Distances beyond this are reported as this, m."""


def _index_pairs(pairs: list[tuple[int, int]]) -> NDArray[np.int64]:
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


class ArmCollision:
    """The coarse collision model of one moment: what the hands look like, what is held, what stands around.

    Args:
        cell: arm bases and static boxes.
        q_hands: finger angles (13) of both hands, rad.
        held: the box in one hand, or None.
        obstacles: further boxes.
        appeared: boxes that nobody knew of before, of which more may be kept (`more`, m), by less coarse shapes: beside
            the capsules of the palms and the held box their edges count, too.
        exempt: pairs of body names (`<side>_arm`, `<side>_hand`, `held`, box names) that may touch.

    Joint vectors are (14,): right arm, left arm, rad.
    """

    def __init__(
        self,
        cell: Workcell,
        q_hands: Mapping[Side, ArrayLike],
        held: HeldBox | None = None,
        obstacles: tuple[OrientedBox, ...] = (),
        exempt: Collection[tuple[str, str]] = (),
        appeared: tuple[OrientedBox, ...] = (),
    ) -> None:
        coarse = robot_capsules(q_hands, held)
        edges = edge_capsules(held) if appeared else []
        capsules = [*coarse, *edges]
        boxes = (*cell.statics, *obstacles, *appeared)
        known = len(boxes) - len(appeared)
        self._bodies = [capsule.body for capsule in capsules]
        self._boxes = [box.name for box in boxes]
        excused = self._exemptions(exempt)
        pairs = _index_pairs(capsule_pairs(coarse, excused))
        with_boxes = _index_pairs(
            [(i, k) for i, k in box_pairs(capsules, self._boxes, excused) if i < len(coarse) or k >= known]
        )
        number = {name: number for number, name in enumerate(dict.fromkeys((*self._bodies, *self._boxes)))}
        body = np.array([number[name] for name in self._bodies], dtype=np.int64)
        box = np.array([number[name] for name in self._boxes], dtype=np.int64)
        first = np.concatenate([body[pairs[:, 0]], body[with_boxes[:, 0]]])
        second = np.concatenate([body[pairs[:, 1]], box[with_boxes[:, 1]]])
        meetings, meeting = np.unique(first * len(number) + second, return_inverse=True)
        self._touching = np.zeros(len(meetings))
        new = [number[box.name] for box in appeared]
        self._with_appeared = np.isin(meetings % len(number), new).astype(float)
        self.tables = _Tables(
            origins=link_origins(),
            bases=np.array([cell.X_world_base[side] for side in SIDES]),
            mounts=np.array([mount(side) for side in SIDES]),
            frame=np.array([frame_index(capsule) for capsule in capsules], dtype=np.int64),
            start=np.array([capsule.start for capsule in capsules]),
            end=np.array([capsule.end for capsule in capsules]),
            radius=np.array([capsule.radius for capsule in capsules]),
            pairs=pairs,
            X_world_box=np.array([box.X_world_box for box in boxes]).reshape(-1, 4, 4),
            half=np.array([box.half for box in boxes], dtype=float).reshape(-1, 3),
            box_pairs=with_boxes,
            meeting=meeting,
        )

    def _exemptions(self, exempt: Collection[tuple[str, str]]) -> frozenset[frozenset[str]]:
        known = {*self._bodies, *self._boxes, "held"}
        for pair in exempt:
            for name in pair:
                if name not in known:
                    raise ValueError(f"exempt: got body {name!r}, allowed are {', '.join(sorted(known))}")
        return frozenset(frozenset(pair) for pair in exempt)

    def clearance(self, q: ArrayLike) -> Clearance:
        """Return the least clearance at q (14), rad; distances beyond `FAR` come back as `FAR`."""
        distance, pair = least_slack(self.tables, arms_vector(q), self._touching, FAR, -np.inf)
        if pair < 0:
            return Clearance(distance, ("", ""))
        if pair < len(self.tables.pairs):
            first, second = self.tables.pairs[pair]
            return Clearance(distance, (self._bodies[first], self._bodies[second]))
        first, box = self.tables.box_pairs[pair - len(self.tables.pairs)]
        return Clearance(distance, (self._bodies[first], self._boxes[box]))

    def is_free(self, q: ArrayLike, margin: float = 0.0, more: float = 0.0) -> bool:
        """Return whether every pair is at least `margin` (m) apart at q (14), by `more` from what has appeared."""
        extra = more * self._with_appeared
        return bool(least_slack(self.tables, arms_vector(q), extra, margin, margin)[0] >= margin)

    def margins(self, margin: float, ends: Iterable[ArrayLike] = (), dip: float = 0.0, more: float = 0.0) -> Matrix:
        """Return what each two bodies have to keep (meetings,), m: min(margin, d(q) - dip) over the ends q (14).

        Each two by themselves: a hand that stands near an obstacle does not let the box in it come near to the table.
        `more` is added to the margin from what has appeared.
        """
        wanted = margin + more * self._with_appeared
        cleared = wanted + dip
        for q in map(arms_vector, ends):
            while (nearest := least_slack(self.tables, q, cleared, 0.0, -np.inf))[1] >= 0:
                slack, pair = nearest
                cleared[self.tables.meeting[pair]] += slack
        return np.minimum(wanted, cleared - dip)

    def edge_free(self, q_from: ArrayLike, q_to: ArrayLike, margins: Matrix, step: float = 0.05) -> bool:
        """Return whether the straight joint path keeps `margins` (meetings,), m, sampled at most `step` rad apart."""
        return bool(edge_keeps(self.tables, arms_vector(q_from), arms_vector(q_to), margins, step))


def arms_vector(q: ArrayLike) -> Matrix:
    """Return q as a contiguous (14,) array, right then left; `ValueError` names the shape it got."""
    q = np.ascontiguousarray(q, dtype=float)
    if q.shape != (ARMS_DOF,):
        raise ValueError(f"arm joints: got shape {q.shape}, allowed is ({ARMS_DOF},): right then left")
    return q
