"""The paper's groups of link boxes, and how a group's smallest distances become one reciprocal force.

B1 palm, B2 thumb (b2 .. b6), B3 the other fingers (b7 .. b18). A group's force is the weighted mean of the
forces of its nearest boxes: `hard` weighs every d_j <= d_min + epsilon alike (the paper, 1 / m_i each);
`smooth` weighs by w_j = exp(-(d_j - d_min) / epsilon) / sum, the gradient of the soft minimum
d = d_min - epsilon log sum_j exp(-(d_j - d_min) / epsilon), which does not jump when boxes change order.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from preshape.control.link_boxes import PARTS
from preshape.hal import sah_hand
from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix

Group = Literal["palm", "thumb", "fingers"]
GROUPS: tuple[Group, Group, Group] = ("palm", "thumb", "fingers")
"""B1, B2, B3 of the paper."""

Ties = Literal["smooth", "hard"]
TIES: tuple[Ties, Ties] = ("smooth", "hard")

Member = Literal["palm", "thumb", "fore", "middle", "ring"]
MEMBERS: tuple[Member, ...] = ("palm", "thumb", "fore", "middle", "ring")
"""The palm and the four fingers: what a contact rule speaks of."""

SOFT_WINDOW = 10.0
"""Boxes farther than this many epsilon beyond the nearest weigh nothing (exp(-10) = 5e-5)."""


def group_of(member: Member) -> Group:
    """Return the group a member belongs to."""
    return member if member == "palm" or member == "thumb" else "fingers"


def _member_of(part: str) -> Member:
    return next(member for member in MEMBERS if part == member or part.startswith(f"{member}_"))


PART_MEMBERS: tuple[Member, ...] = tuple(_member_of(part) for part in PARTS)
"""Member of each part b1 .. b18."""


def _part_groups() -> NDArray[np.int64]:
    groups = np.array([GROUPS.index(group_of(member)) for member in PART_MEMBERS])
    if np.bincount(groups).tolist() != [1, 5, 12] or np.any(np.diff(groups) < 0):
        raise ValueError(f"the parts {tuple(sah_hand.PARTS)} are not in the order palm, thumb, other fingers")
    groups.setflags(write=False)
    return groups


PART_GROUPS = _part_groups()
"""Index into `GROUPS` of each part b1 .. b18."""


def group_parts(group: Group) -> range:
    """Return the indices of a group's parts."""
    members = np.flatnonzero(PART_GROUPS == GROUPS.index(group))
    return range(int(members[0]), int(members[-1]) + 1)


@compiled
def tie_weights(smooth: bool, distance: Matrix, count: int, epsilon: float, weight: Matrix) -> float:
    """Write the weights (sum 1) of `count` distances (m); return the group's distance: soft or true minimum."""
    nearest = distance[0]
    for j in range(1, count):
        nearest = min(nearest, distance[j])
    total = 0.0
    for j in range(count):
        beyond = (distance[j] - nearest) / epsilon
        if smooth:
            weight[j] = np.exp(-beyond) if beyond < SOFT_WINDOW else 0.0
        else:
            weight[j] = 1.0 if beyond <= 1.0 else 0.0
        total += weight[j]
    for j in range(count):
        weight[j] /= total
    return nearest - epsilon * np.log(total) if smooth else nearest
