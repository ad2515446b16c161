"""Rigid transforms as 4x4 matrices: X_a_b maps points of frame b into frame a."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Matrix = NDArray[np.float64]

_EYE3, _EYE4 = np.eye(3), np.eye(4)


def rpy_matrix(rpy: ArrayLike) -> Matrix:
    """Return R = Rz(yaw) Ry(pitch) Rx(roll), the URDF convention, from angles in rad."""
    roll, pitch, yaw = np.asarray(rpy, float)
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_angles(R: Matrix) -> Matrix:
    """Return roll, pitch, yaw (rad) with `rpy_matrix(rpy_angles(R)) == R`, also at pitch +-90 deg."""
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) < 1e-9:
        return np.array([np.arctan2(-R[1, 2], R[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def transform(p: ArrayLike = (0.0, 0.0, 0.0), R: ArrayLike | None = None) -> Matrix:
    """Return the 4x4 transform with translation p (m) and rotation R (default: none)."""
    X = _EYE4.copy()
    X[:3, 3] = p
    if R is not None:
        X[:3, :3] = R
    return X


def raised(X: Matrix, height: float) -> Matrix:
    """Return a pose moved straight up in the world by a height, m."""
    return transform((0.0, 0.0, height)) @ X


def inverse(X: Matrix) -> Matrix:
    """Return X_b_a of X_a_b; works on stacks (..., 4, 4)."""
    if X.ndim == 2:
        out = _EYE4.copy()
        out[:3, :3] = R_T = X[:3, :3].T
        out[:3, 3:] = -(R_T @ X[:3, 3:])
        return out
    R_T = np.swapaxes(X[..., :3, :3], -1, -2)
    out = np.zeros_like(X)
    out[..., :3, :3] = R_T
    out[..., :3, 3] = -(R_T @ X[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def length(v: Matrix) -> float:
    """Return the Euclidean norm sqrt(v . v) of a vector (n,), in its unit; quicker than numpy's for a short one."""
    return math.sqrt(v @ v)


def cross(a: ArrayLike, b: ArrayLike) -> Matrix:
    """Return a x b of two vectors (3,); quicker than numpy's. `ValueError` for another length."""
    (ax, ay, az), (bx, by, bz) = np.asarray(a, float).tolist(), np.asarray(b, float).tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def hat(w: ArrayLike) -> Matrix:
    """Return the skew matrix W of a vector w (3,): W v = w x v."""
    x, y, z = np.asarray(w, float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp_so3(w: ArrayLike) -> Matrix:
    """Return the rotation by the vector w (rad), by Rodrigues' formula."""
    w = np.asarray(w, float)
    angle = length(w)
    K = hat(w)
    if angle < 1e-8:
        return _EYE3 + K + 0.5 * K @ K
    return _EYE3 + np.sin(angle) / angle * K + (1.0 - np.cos(angle)) / angle**2 * K @ K


def log_so3(R: Matrix) -> Matrix:
    """Return the rotation vector w (rad, |w| <= pi) with exp_so3(w) == R."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R.tolist()
    axis = 0.5 * np.array([zy - yz, xz - zx, yx - xy])
    sine = length(axis)
    cosine = 0.5 * (xx + yy + zz - 1.0)
    angle = np.arctan2(sine, cosine)
    if sine > 1e-6:
        return axis * (angle / sine)
    if cosine > 0:
        return axis
    # Near pi the axis is the dominant column of R + I.
    B = 0.5 * (R + np.eye(3))
    column = B[:, int(np.argmax(np.diag(B)))]
    return angle * column / np.linalg.norm(column)


def axis_rotation(axis: ArrayLike, angle: float) -> Matrix:
    """Return the rotation about a unit axis by an angle in rad."""
    return exp_so3(np.asarray(axis, float) * angle)


def quaternion_xyzw(R: Matrix) -> Matrix:
    """Return the unit quaternion (4,), its scalar last and never negative, of a rotation."""
    w = log_so3(R)
    half = 0.5 * length(w)
    return np.append(0.5 * np.sinc(half / np.pi) * w, np.cos(half))


def rotation_xyzw(q: ArrayLike) -> Matrix:
    """Return the rotation of a quaternion (4,), its scalar last; its length does not matter, zero is refused."""
    x, y, z, w = (float(value) for value in np.asarray(q, float))
    norm = x * x + y * y + z * z + w * w
    if not norm > 0.0:
        raise ValueError(f"quaternion: got {[x, y, z, w]}, allowed is one of any length but zero")
    K = hat((x, y, z))
    return _EYE3 + (2.0 / norm) * (w * K + K @ K)
