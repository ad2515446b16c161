"""Where the 18 parts and the four fingertips of a hand are in its palm frame, with exact Jacobians.

Part k hangs on joint k - 1 (the palm is part 0), in the order of `sah_hand.PARTS`. A joint's frame is
X_parent_joint Rz(s q): every axis of this hand is +-z of its own frame, s is that sign. The distal joint
repeats the angle of the middle joint, so both columns of the 17-joint Jacobian are summed in the 13.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal import sah_hand
from preshape.hal.compiled import compiled
from preshape.hal.description import hand_joint_origin, joint_axis
from preshape.hal.layout import HAND_DOF, LAYOUT, Side, hand_joint_names
from preshape.hal.transform import Matrix

PART_NAMES: tuple[str, ...] = tuple(sah_hand.PARTS)
PART_COUNT = len(PART_NAMES)


class HandTables(NamedTuple):
    """The tree as arrays, one row a joint (17), parents before children."""

    parent: NDArray[np.int64]
    drive: NDArray[np.int64]
    sign: Matrix
    R_parent_joint: Matrix
    p_parent_joint: Matrix
    tip_part: NDArray[np.int64]
    tip_offset: float


def _build_tables(side: Side) -> HandTables:
    joints = sah_hand.JOINTS
    axes = np.array([joint_axis(side, joint.axis) for joint in joints])
    if not np.array_equal(np.abs(axes), np.tile([0.0, 0.0, 1.0], (len(joints), 1))):
        raise ValueError(f"every joint axis must be +-z of its own frame, got {axes.tolist()}")
    if tuple(joint.child for joint in joints) != PART_NAMES[1:]:
        raise ValueError(f"joints must be in the order of the parts {PART_NAMES[1:]}")
    origins = np.array([hand_joint_origin(side, joint) for joint in joints])
    return HandTables(
        parent=np.array([PART_NAMES.index(joint.parent) for joint in joints]),
        drive=np.array([sah_hand.ACTUATED.index(joint.coupled_to or joint.name) for joint in joints]),
        sign=axes[:, 2].copy(),
        R_parent_joint=np.ascontiguousarray(origins[:, :3, :3]),
        p_parent_joint=np.ascontiguousarray(origins[:, :3, 3]),
        tip_part=np.array([PART_NAMES.index(f"{finger}_dist") for finger in sah_hand.FINGERS]),
        tip_offset=sah_hand.TIP_OFFSET,
    )


@compiled
def part_frames(tables: HandTables, q: Matrix, R: Matrix, p: Matrix) -> None:
    """Write rotations R (18, 3, 3) and origins p (18, 3) of the parts in the palm frame for angles q (13)."""
    R[0] = np.eye(3)
    p[0] = 0.0
    for j in range(tables.parent.shape[0]):
        up, at = tables.parent[j], j + 1
        angle = tables.sign[j] * q[tables.drive[j]]
        c, s = np.cos(angle), np.sin(angle)
        for a in range(3):
            x = y = z = 0.0
            o = p[up, a]
            for b in range(3):
                r = R[up, a, b]
                x += r * tables.R_parent_joint[j, b, 0]
                y += r * tables.R_parent_joint[j, b, 1]
                z += r * tables.R_parent_joint[j, b, 2]
                o += r * tables.p_parent_joint[j, b]
            R[at, a, 0] = c * x + s * y
            R[at, a, 1] = c * y - s * x
            R[at, a, 2] = z
            p[at, a] = o


@compiled
def point_jacobian(tables: HandTables, R: Matrix, p: Matrix, part: int, x: Matrix, J: Matrix) -> None:
    """Write dx/dq (3, 13) of a point x (palm frame, m) fixed to a part: sum over its joints of s z cross (x - o)."""
    J[:] = 0.0
    at = part
    while at > 0:
        j = at - 1
        s, k = tables.sign[j], tables.drive[j]
        rx, ry, rz = x[0] - p[at, 0], x[1] - p[at, 1], x[2] - p[at, 2]
        zx, zy, zz = s * R[at, 0, 2], s * R[at, 1, 2], s * R[at, 2, 2]
        J[0, k] += zy * rz - zz * ry
        J[1, k] += zz * rx - zx * rz
        J[2, k] += zx * ry - zy * rx
        at = tables.parent[j]


@compiled
def tips_and_jacobians(tables: HandTables, q: Matrix, R: Matrix, p: Matrix, tips: Matrix, J: Matrix) -> None:
    """Write the part frames, the four fingertip frames' origins (4, 3) and their Jacobians (4, 3, 13)."""
    part_frames(tables, q, R, p)
    for f in range(tables.tip_part.shape[0]):
        part = tables.tip_part[f]
        for a in range(3):
            tips[f, a] = p[part, a] + R[part, a, 0] * tables.tip_offset
        point_jacobian(tables, R, p, part, tips[f], J[f])


def _checked(q: ArrayLike) -> Matrix:
    angles = np.ascontiguousarray(q, dtype=np.float64)
    if angles.shape != (HAND_DOF,):
        raise ValueError(
            f"hand joints: got shape {angles.shape}, allowed is ({HAND_DOF},): {', '.join(sah_hand.ACTUATED)}"
        )
    return angles


def _stack(R: Matrix, p: Matrix) -> Matrix:
    X = np.zeros((len(R), 4, 4))
    X[:, :3, :3], X[:, :3, 3], X[:, 3, 3] = R, p, 1.0
    return X


class HandKinematics:
    """Forward kinematics of one hand; use `hand_kinematics(side)`, which keeps one value a side.

    Every q is the hand's 13 actuated joint angles (rad) in layout order; results are in the palm frame, m.
    """

    def __init__(self, side: Side) -> None:
        self.side: Side = side
        self.tables = _build_tables(side)
        hand = LAYOUT.hand(side)
        self.joint_names = hand_joint_names(side)
        self.lower, self.upper = LAYOUT.lower[hand], LAYOUT.upper[hand]

    def _frames(self, q: ArrayLike) -> tuple[Matrix, Matrix]:
        R, p = np.empty((PART_COUNT, 3, 3)), np.empty((PART_COUNT, 3))
        part_frames(self.tables, _checked(q), R, p)
        return R, p

    def part_poses(self, q: ArrayLike) -> Matrix:
        """Return X_palm_part of all parts b1 .. b18, shape (18, 4, 4)."""
        return _stack(*self._frames(q))

    def part_jacobians(self, q: ArrayLike) -> Matrix:
        """Return the parts' Jacobians (18, 6, 13): rows 0-2 velocity of the frame's origin, 3-5 angular velocity."""
        R, p = self._frames(q)
        J = np.zeros((PART_COUNT, 6, HAND_DOF))
        for part in range(1, PART_COUNT):
            point_jacobian(self.tables, R, p, part, p[part], J[part, :3])
            J[part, 3:] = J[self.tables.parent[part - 1], 3:]
            J[part, 3:, self.tables.drive[part - 1]] += self.tables.sign[part - 1] * R[part, :, 2]
        return J

    def tip_poses(self, q: ArrayLike) -> Matrix:
        """Return X_palm_tip of thumb, fore, middle, ring, shape (4, 4, 4)."""
        X = self.part_poses(q)[self.tables.tip_part]
        X[:, :3, 3] += X[:, :3, 0] * self.tables.tip_offset
        return X

    def tips(self, q: ArrayLike) -> tuple[Matrix, Matrix]:
        """Return the fingertips h_p_f (4, 3) of eq. (4) and their Jacobians dh_p_f/dq (4, 3, 13), m/rad."""
        tips, J = np.empty((4, 3)), np.empty((4, 3, HAND_DOF))
        R, p = np.empty((PART_COUNT, 3, 3)), np.empty((PART_COUNT, 3))
        tips_and_jacobians(self.tables, _checked(q), R, p, tips, J)
        return tips, J


@cache
def hand_kinematics(side: Side) -> HandKinematics:
    """Return the kinematics of one hand."""
    return HandKinematics(side)
