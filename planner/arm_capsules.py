"""The coarse shapes of both arms, their hands and a held box as capsules, and what they must stay clear of.

Every body has a name that exemptions use: `<side>_arm`, `<side>_hand`, `held`, and the names of the boxes.
A box is covered by capsules along its longest edge whose radius is its shortest half edge; its corners
stick out by at most 0.73 of that radius, which the caller's margin has to cover, or `edge_capsules` of the thickest.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal import panda_arm, sah_hand
from preshape.hal.description import part_box
from preshape.hal.layout import HAND_DOF, SIDES, Side
from preshape.hal.transform import Matrix, transform
from preshape.planner.arm_kinematics import FRAME_COUNT, PALM
from preshape.planner.hand_kinematics import PART_NAMES, hand_kinematics

APART = 4
"""Links of one arm are compared when at least this many joints lie between their frames: nearer ones overlap."""


@dataclass(frozen=True, slots=True, eq=False)
class Capsule:
    """A capsule of body `body` in frame `frame` of an arm (0 .. 7 links, 8 palm): end points and radius, m."""

    body: str
    side: Side
    frame: int
    start: Matrix
    end: Matrix
    radius: float


@dataclass(frozen=True, slots=True, eq=False)
class HeldBox:
    """A box fixed in the palm of one hand: its pose in the palm's frame and its half edges, m."""

    side: Side
    X_palm_box: Matrix
    half: Matrix


def box_segments(X_frame_box: Matrix, half: ArrayLike) -> list[tuple[Matrix, Matrix, float]]:
    """Return (start, end, radius) of the capsules that cover a box, in its frame's parent, m."""
    half = np.asarray(half, float)
    short, middle, long = np.argsort(half, kind="stable")
    radius = float(half[short])
    count = max(1, int(np.ceil(half[middle] / radius - 1e-9)))
    offsets = np.linspace(-1.0, 1.0, count) * (half[middle] - radius) if count > 1 else np.zeros(1)
    R, p = X_frame_box[:3, :3], X_frame_box[:3, 3]
    reach = (half[long] - radius) * R[:, long]
    return [(p + y * R[:, middle] - reach, p + y * R[:, middle] + reach, radius) for y in offsets]


def arm_capsules(side: Side) -> list[Capsule]:
    """Return the capsules of one arm's links."""
    return [
        Capsule(f"{side}_arm", side, c.link, np.array(c.start), np.array(c.end), c.radius) for c in panda_arm.CAPSULES
    ]


def hand_capsules(side: Side, q_hand: ArrayLike) -> list[Capsule]:
    """Return the capsules of one hand with its fingers at q_hand (13), rad."""
    q_hand = np.asarray(q_hand, float)
    if q_hand.shape != (HAND_DOF,):
        raise ValueError(f"{side} hand joints: got shape {q_hand.shape}, allowed is ({HAND_DOF},)")
    capsules: list[Capsule] = []
    for part, X_palm_part in zip(PART_NAMES, hand_kinematics(side).part_poses(q_hand), strict=True):
        shape = sah_hand.PARTS[part][0]
        center, half = part_box(side, part)
        X_palm_box = X_palm_part @ transform(center)
        if shape.kind == "capsule":
            radius, start, end = shape.size
            reach = (end - start) / 2 * X_palm_box[:3, 0]
            segments = [(X_palm_box[:3, 3] - reach, X_palm_box[:3, 3] + reach, radius)]
        else:
            segments = box_segments(X_palm_box, half)
        capsules += [Capsule(f"{side}_hand", side, PALM, start, end, radius) for start, end, radius in segments]
    return capsules


def edge_capsules(held: HeldBox | None) -> list[Capsule]:
    """Return the twelve edges of each palm and of the held box as capsules without thickness: what sticks out most."""
    edges: list[Capsule] = []
    for side in SIDES:
        center, half = part_box(side, "palm")
        edges += _edges(f"{side}_hand", side, transform(center), half)
    return edges if held is None else edges + _edges("held", held.side, held.X_palm_box, held.half)


def _edges(body: str, side: Side, X_palm_box: Matrix, half: Matrix) -> list[Capsule]:
    corners = np.array(list(product((-1.0, 1.0), repeat=3))) * half @ X_palm_box[:3, :3].T + X_palm_box[:3, 3]
    along = [(i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit]
    return [Capsule(body, side, PALM, corners[i], corners[j], 0.0) for i, j in along]


def held_capsules(held: HeldBox) -> list[Capsule]:
    """Return the capsules of a held box."""
    segments = box_segments(held.X_palm_box, held.half)
    return [Capsule("held", held.side, PALM, start, end, radius) for start, end, radius in segments]


def robot_capsules(q_hands: Mapping[Side, ArrayLike], held: HeldBox | None) -> list[Capsule]:
    """Return all capsules of both arms, both hands and the held box."""
    capsules = [c for side in SIDES for c in (*arm_capsules(side), *hand_capsules(side, q_hands[side]))]
    return capsules + (held_capsules(held) if held is not None else [])


def capsule_pairs(capsules: list[Capsule], exempt: frozenset[frozenset[str]]) -> list[tuple[int, int]]:
    """Return the index pairs to compare: the two sides with each other, and one arm's frames `APART` or more apart."""
    return list(_capsule_pairs(tuple((c.body, c.side, c.frame) for c in capsules), exempt))


@lru_cache(maxsize=64)
def _capsule_pairs(
    capsules: tuple[tuple[str, Side, int], ...], exempt: frozenset[frozenset[str]]
) -> tuple[tuple[int, int], ...]:
    """Return the pairs for capsules given as (body, side, frame): the same for every posture of the robot."""
    pairs: list[tuple[int, int]] = []
    for i, (body, side, frame) in enumerate(capsules):
        for j in range(i + 1, len(capsules)):
            other_body, other_side, other_frame = capsules[j]
            if frozenset((body, other_body)) in exempt or (frame <= 1 and other_frame <= 1):
                continue
            if side != other_side or abs(frame - other_frame) >= APART:
                pairs.append((i, j))
    return tuple(pairs)


def box_pairs(
    capsules: list[Capsule], boxes: Iterable[str], exempt: frozenset[frozenset[str]]
) -> list[tuple[int, int]]:
    """Return (capsule, box) index pairs; links 0 and 1 never leave their place and are left out."""
    return [
        (i, k)
        for i, capsule in enumerate(capsules)
        for k, box in enumerate(boxes)
        if capsule.frame > 1 and frozenset((capsule.body, box)) not in exempt
    ]


def frame_index(capsule: Capsule) -> int:
    """Return the row of a capsule's frame in the stacked frames of right then left arm, (18, 4, 4)."""
    return SIDES.index(capsule.side) * FRAME_COUNT + capsule.frame
