"""The bounding boxes of both hands (18 each) and both arms (8 each), from compiled forward kinematics.

A *node* is a rigid link: per side arm link 0 .. 7, then the hand's parts b1 (palm) .. b18; right side first.
Node n hangs on its parent by X_parent_n Rz(sign q): every joint of this robot turns about +-z of its own frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal import panda_arm, sah_hand
from preshape.hal.compiled import compiled
from preshape.hal.description import ARM_BASE, hand_joint_origin, joint_axis, palm_mount, part_box
from preshape.hal.layout import LAYOUT, SIDES, Side, arm_joint_names
from preshape.hal.transform import Matrix, hat, rpy_matrix, transform

PARTS: tuple[str, ...] = tuple(sah_hand.PARTS)
PART_COUNT = len(PARTS)
ARM_LINKS = len(panda_arm.CAPSULES)
SIDE_NODES = ARM_LINKS + PART_COUNT
NODE_COUNT = 2 * SIDE_NODES

NODES: tuple[str, ...] = tuple(
    f"{side}_{name}" for side in SIDES for name in (*(f"arm_link{n}" for n in range(ARM_LINKS)), *PARTS)
)
"""Link names of the shared description, in node order."""


class Tree(NamedTuple):
    """Parent node, driving joint (layout index, -1 = fixed) and sign of every node; its fixed place X_parent_node."""

    parent: NDArray[np.int64]
    drive: NDArray[np.int64]
    sign: Matrix
    R_parent: Matrix
    p_parent: Matrix


class NodePoses(NamedTuple):
    """Poses in the world: node frames R (52, 3, 3), p (52, 3), box axes (52, 3, 3) and box centres (52, 3), m."""

    R: Matrix
    p: Matrix
    R_box: Matrix
    p_box: Matrix


def arm_nodes(side: Side) -> slice:
    """Return the nodes of one arm's links."""
    start = SIDES.index(side) * SIDE_NODES
    return slice(start, start + ARM_LINKS)


def hand_nodes(side: Side) -> slice:
    """Return the nodes of one hand's 18 parts, the palm first."""
    start = arm_nodes(side).stop
    return slice(start, start + PART_COUNT)


def _along(direction: Matrix) -> Matrix:
    """Return a rotation whose z axis points along a direction."""
    z = direction / float(np.linalg.norm(direction))
    across = hat(np.eye(3)[int(np.argmin(np.abs(z)))]) @ z
    x = across / float(np.linalg.norm(across))
    return np.column_stack([x, hat(z) @ x, z])


def _side_rows(side: Side, X_world_base: Matrix) -> list[tuple[int, int, float, Matrix]]:
    """Return (parent, drive, sign, X_parent_node) of one side's nodes."""
    arm, hand = arm_nodes(side), hand_nodes(side)
    rows = [(-1, -1, 1.0, X_world_base)]
    for number, (name, joint) in enumerate(zip(arm_joint_names(side), panda_arm.JOINTS, strict=True)):
        X = transform(joint.xyz, rpy_matrix((joint.roll, 0.0, 0.0)))
        rows.append((arm.start + number, LAYOUT.index(name), 1.0, X))
    rows.append((arm.stop - 1, -1, 1.0, palm_mount(side)))
    for joint in sah_hand.JOINTS:
        axis = joint_axis(side, joint.axis)
        if not np.array_equal(np.abs(axis), [0.0, 0.0, 1.0]):
            raise ValueError(f"joint {joint.name}: got axis {axis.tolist()}, allowed is +-z of its own frame")
        parent = hand.start + PARTS.index(joint.parent)
        drive = LAYOUT.index(f"{side}_{joint.coupled_to or joint.name}")
        rows.append((parent, drive, float(axis[2]), hand_joint_origin(side, joint)))
    return rows


def _build_tree(X_world_base: Mapping[Side, Matrix]) -> Tree:
    if tuple(joint.child for joint in sah_hand.JOINTS) != PARTS[1:]:
        raise ValueError(f"hand joints must be in the order of the parts {PARTS[1:]}")
    rows = [row for side in SIDES for row in _side_rows(side, X_world_base[side])]
    X = np.array([row[3] for row in rows])
    return Tree(
        parent=np.array([row[0] for row in rows]),
        drive=np.array([row[1] for row in rows]),
        sign=np.array([row[2] for row in rows]),
        R_parent=np.ascontiguousarray(X[:, :3, :3]),
        p_parent=np.ascontiguousarray(X[:, :3, 3]),
    )


def _local_boxes() -> tuple[Matrix, Matrix, Matrix]:
    """Return centres, axes and half edges of all boxes in their node's frame (bounding boxes of the capsules)."""
    centers: list[Matrix] = []
    axes: list[Matrix] = []
    halves: list[Matrix] = []
    for side in SIDES:
        for capsule in panda_arm.CAPSULES:
            start, end = np.array(capsule.start), np.array(capsule.end)
            straight = float(np.linalg.norm(end - start))
            centers.append((start + end) / 2)
            axes.append(_along(end - start))
            halves.append(np.array([capsule.radius, capsule.radius, straight / 2 + capsule.radius]))
        for part in PARTS:
            center, half = part_box(side, part)
            centers.append(center)
            axes.append(np.eye(3))
            halves.append(half)
    return np.array(centers), np.array(axes), np.array(halves)


@compiled
def _forward(tree: Tree, p_local: Matrix, R_local: Matrix, q: Matrix, poses: NodePoses) -> None:
    R, p = poses.R, poses.p
    for n in range(tree.parent.shape[0]):
        up, drive = tree.parent[n], tree.drive[n]
        c, s = 1.0, 0.0
        if drive >= 0:
            angle = tree.sign[n] * q[drive]
            c, s = np.cos(angle), np.sin(angle)
        for a in range(3):
            if up < 0:
                x, y, z = tree.R_parent[n, a, 0], tree.R_parent[n, a, 1], tree.R_parent[n, a, 2]
                o = tree.p_parent[n, a]
            else:
                x = y = z = 0.0
                o = p[up, a]
                for b in range(3):
                    r = R[up, a, b]
                    x += r * tree.R_parent[n, b, 0]
                    y += r * tree.R_parent[n, b, 1]
                    z += r * tree.R_parent[n, b, 2]
                    o += r * tree.p_parent[n, b]
            R[n, a, 0], R[n, a, 1], R[n, a, 2] = c * x + s * y, c * y - s * x, z
            p[n, a] = o
        for a in range(3):
            o = p[n, a]
            for b in range(3):
                o += R[n, a, b] * p_local[n, b]
                value = 0.0
                for k in range(3):
                    value += R[n, a, k] * R_local[n, k, b]
                poses.R_box[n, a, b] = value
            poses.p_box[n, a] = o


@compiled
def _point_jacobian(tree: Tree, poses: NodePoses, node: int, x: Matrix, J: Matrix) -> None:
    J[:] = 0.0
    while node >= 0:
        drive = tree.drive[node]
        if drive >= 0:
            s = tree.sign[node]
            zx, zy, zz = s * poses.R[node, 0, 2], s * poses.R[node, 1, 2], s * poses.R[node, 2, 2]
            rx, ry, rz = x[0] - poses.p[node, 0], x[1] - poses.p[node, 1], x[2] - poses.p[node, 2]
            J[0, drive] += zy * rz - zz * ry
            J[1, drive] += zz * rx - zx * rz
            J[2, drive] += zx * ry - zy * rx
        node = tree.parent[node]


class LinkBoxes:
    """The boxes of the whole robot; `update` writes their poses in place."""

    def __init__(self, X_world_base: Mapping[Side, Matrix] | None = None) -> None:
        """Build the tables for arm bases (default: the description's)."""
        self.tree = _build_tree(X_world_base or {side: transform(ARM_BASE[side]) for side in SIDES})
        self._p_local, self._R_local, self.half = _local_boxes()
        eyes = np.tile(np.eye(3), (NODE_COUNT, 1, 1))
        self.poses = NodePoses(eyes.copy(), np.zeros((NODE_COUNT, 3)), eyes.copy(), np.zeros((NODE_COUNT, 3)))

    def update(self, q: ArrayLike) -> NodePoses:
        """Write and return the poses for the 40 joint angles (rad, layout order)."""
        angles = np.ascontiguousarray(q, dtype=np.float64)
        if angles.shape != (LAYOUT.dof,):
            raise ValueError(f"joint angles: got shape {angles.shape}, allowed is ({LAYOUT.dof},)")
        _forward(self.tree, self._p_local, self._R_local, angles, self.poses)
        return self.poses

    def palm(self, side: Side) -> Matrix:
        """Return X_world_palm (4, 4) as of the last `update`: the hand base frame of the paper."""
        node = hand_nodes(side).start
        return transform(self.poses.p[node], self.poses.R[node])

    def point_jacobian(self, node: str, x: ArrayLike) -> Matrix:
        """Return dx/dq (3, 40), m/rad, of a world point x (m) fixed to a node, as of the last `update`."""
        if node not in NODES:
            raise KeyError(f"node {node!r} is none of {', '.join(NODES)}")
        J = np.empty((3, LAYOUT.dof))
        _point_jacobian(self.tree, self.poses, NODES.index(node), np.asarray(x, dtype=np.float64), J)
        return J
