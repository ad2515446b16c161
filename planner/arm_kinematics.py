"""Forward kinematics and Jacobian of one 7-joint arm up to its palm, compiled.

X_world_link0 is the arm's base; X_link(k-1)_link(k) = T(xyz_k) Rx(roll_k) Rz(q_k) with the numbers of
`hal.panda_arm`; the palm hangs on link 7 by the mount of `hal.description`.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal import panda_arm
from preshape.hal.compiled import compiled
from preshape.hal.description import palm_mount
from preshape.hal.layout import ARM_DOF, Side
from preshape.hal.transform import Matrix, rpy_matrix, transform

FRAME_COUNT = ARM_DOF + 2
"""Frames of one arm: link 0 .. link 7, then the palm."""
PALM = FRAME_COUNT - 1

_ORIGINS = np.array([transform(joint.xyz, rpy_matrix((joint.roll, 0.0, 0.0))) for joint in panda_arm.JOINTS])


@compiled
def multiply(A: Matrix, B: Matrix, out: Matrix) -> None:
    """Write the rigid transform A B into out; none of them may share memory with out."""
    for i in range(3):
        for j in range(4):
            total = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
            out[i, j] = total + A[i, 3] if j == 3 else total
        out[3, i] = 0.0
    out[3, 3] = 1.0


@compiled
def chain_frames(origins: Matrix, X_world_base: Matrix, X_link7_palm: Matrix, q: Matrix, out: Matrix) -> None:
    """Write X_world_frame of link 0 .. 7 and the palm, (9, 4, 4), for joint angles q (7), rad."""
    out[0] = X_world_base
    X_joint = np.empty((4, 4))
    for k in range(q.shape[0]):
        cosine, sine = np.cos(q[k]), np.sin(q[k])
        for i in range(4):
            X_joint[i, 0] = cosine * origins[k, i, 0] + sine * origins[k, i, 1]
            X_joint[i, 1] = cosine * origins[k, i, 1] - sine * origins[k, i, 0]
            X_joint[i, 2] = origins[k, i, 2]
            X_joint[i, 3] = origins[k, i, 3]
        multiply(out[k], X_joint, out[k + 1])
    multiply(out[q.shape[0]], X_link7_palm, out[q.shape[0] + 1])


@compiled
def palm_jacobian(frames: Matrix, J: Matrix) -> None:
    """Write the Jacobian (6, 7) of the palm's origin: rows v (m/s) then w (rad/s) in the world, per rad/s."""
    count = frames.shape[0] - 2
    for k in range(count):
        z0, z1, z2 = frames[k + 1, 0, 2], frames[k + 1, 1, 2], frames[k + 1, 2, 2]
        r0 = frames[count + 1, 0, 3] - frames[k + 1, 0, 3]
        r1 = frames[count + 1, 1, 3] - frames[k + 1, 1, 3]
        r2 = frames[count + 1, 2, 3] - frames[k + 1, 2, 3]
        J[0, k], J[1, k], J[2, k] = z1 * r2 - z2 * r1, z2 * r0 - z0 * r2, z0 * r1 - z1 * r0
        J[3, k], J[4, k], J[5, k] = z0, z1, z2


@cache
def link_origins() -> Matrix:
    """Return X_link(k-1)_joint(k) at angle zero of all joints, (7, 4, 4)."""
    return _ORIGINS.copy()


@cache
def mount(side: Side) -> Matrix:
    """Return X_link7_palm of one side, contiguous."""
    return np.ascontiguousarray(palm_mount(side))


def arm_frames(side: Side, X_world_base: Matrix, q: ArrayLike) -> Matrix:
    """Return X_world_frame of link 0 .. 7 and the palm, (9, 4, 4), for q (7), rad."""
    out = np.empty((FRAME_COUNT, 4, 4))
    chain_frames(link_origins(), np.ascontiguousarray(X_world_base), mount(side), joint_vector(q), out)
    return out


def palm_pose(side: Side, X_world_base: Matrix, q: ArrayLike) -> Matrix:
    """Return X_world_palm for q (7), rad."""
    return arm_frames(side, X_world_base, q)[PALM]


def arm_jacobian(side: Side, X_world_base: Matrix, q: ArrayLike) -> Matrix:
    """Return the palm's Jacobian (6, 7) in the world: linear rows first."""
    J = np.empty((6, ARM_DOF))
    palm_jacobian(arm_frames(side, X_world_base, q), J)
    return J


def manipulability(J: Matrix) -> float:
    """Return sqrt(det(J J^T)) (Yoshikawa 1985) of a Jacobian (6, 7), in m^3."""
    return float(np.sqrt(max(0.0, np.linalg.det(J @ J.T))))


def joint_vector(q: ArrayLike) -> Matrix:
    """Return q as a contiguous (7,) array; `ValueError` names the shape it got."""
    q = np.ascontiguousarray(q, dtype=float)
    if q.shape != (ARM_DOF,):
        raise ValueError(f"arm joints: got shape {q.shape}, allowed is ({ARM_DOF},)")
    return q
