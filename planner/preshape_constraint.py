"""Eq. (4) as a constraint on the displacement from the nominal hand state, with first and second derivatives.

Everything is in the preshaping box's frame. The displacement d = (u, phi, dq) has 3 + 3 + 13 components:
p_box_palm = p_n + u, R_box_palm = R_n exp(hat(phi)), q = q_n + dq, so d = 0 is the nominal state x_n and
the objective of eq. (5), a distance from x_n, is exactly quadratic in d.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix
from preshape.planner.hand_kinematics import HandTables, tips_and_jacobians
from preshape.planner.small_matrix import mat_mat, mat_t_vec, mat_vec

STATE_DOF = 19
"""Palm position (3), palm rotation vector (3), actuated finger joints (13)."""


class Nominal(NamedTuple):
    """The nominal hand state x_n in the box's frame, the fingers that touch and where their tips should be."""

    R: Matrix
    p: Matrix
    q: Matrix
    fingers: NDArray[np.int64]
    targets: Matrix


@compiled
def rotation_and_jacobian(phi: Matrix, R: Matrix, Jr: Matrix) -> None:
    """Write exp(hat(phi)) and the right Jacobian Jr: exp(hat(phi + e)) = exp(hat(phi)) exp(hat(Jr e)) + O(e^2)."""
    t2 = phi[0] ** 2 + phi[1] ** 2 + phi[2] ** 2
    t = np.sqrt(t2)
    if t < 1e-4:
        a, b, c = 1.0 - t2 / 6.0, 0.5 - t2 / 24.0, 1.0 / 6.0 - t2 / 120.0
    else:
        a, b, c = np.sin(t) / t, (1.0 - np.cos(t)) / t2, (t - np.sin(t)) / (t2 * t)
    for i in range(3):
        for j in range(3):
            square = phi[i] * phi[j]
            R[i, j] = b * square
            Jr[i, j] = c * square
    for i in range(3):
        R[i, i] += 1.0 - b * t2
        Jr[i, i] += 1.0 - c * t2
        k, m = (i + 1) % 3, (i + 2) % 3
        R[m, k] += a * phi[i]
        R[k, m] -= a * phi[i]
        Jr[m, k] -= b * phi[i]
        Jr[k, m] += b * phi[i]


@compiled
def tip_constraint(
    tables: HandTables,
    nominal: Nominal,
    d: Matrix,
    frames: Matrix,
    origins: Matrix,
    tips: Matrix,
    J: Matrix,
    c: Matrix,
    A: Matrix,
) -> None:
    """Write c = p_h + R_h h_p_fi - p_fid (3 n, m) of eq. (4) and A = dc/dd (3 n, 19).

    `frames`, `origins`, `tips` and `J` receive the hand's parts and fingertips in the palm frame.
    """
    tips_and_jacobians(tables, nominal.q + d[6:], frames, origins, tips, J)
    E, Jr = np.empty((3, 3)), np.empty((3, 3))
    rotation_and_jacobian(d[3:6], E, Jr)
    R = mat_mat(nominal.R, E)
    A[:] = 0.0
    for n in range(nominal.fingers.shape[0]):
        f = nominal.fingers[n]
        hx, hy, hz = tips[f, 0], tips[f, 1], tips[f, 2]
        turn = mat_mat(np.array([[0.0, hz, -hy], [-hz, 0.0, hx], [hy, -hx, 0.0]]), Jr)
        c[3 * n : 3 * n + 3] = nominal.p + d[:3] + mat_vec(R, tips[f]) - nominal.targets[n]
        for a in range(3):
            A[3 * n + a, a] = 1.0
        A[3 * n : 3 * n + 3, 3:6] = mat_mat(R, turn)
        A[3 * n : 3 * n + 3, 6:] = mat_mat(R, J[f])


@compiled
def _gradient(nominal: Nominal, phi: Matrix, tips: Matrix, J: Matrix, force: Matrix, g: Matrix) -> None:
    """Write the rotation and joint rows of A^T force (16,) at rotation vector phi."""
    E, Jr = np.empty((3, 3)), np.empty((3, 3))
    rotation_and_jacobian(phi, E, Jr)
    R = mat_mat(nominal.R, E)
    moment = np.zeros(3)
    g[:] = 0.0
    for n in range(nominal.fingers.shape[0]):
        f = nominal.fingers[n]
        local = mat_t_vec(R, force[3 * n : 3 * n + 3])
        h = tips[f]
        moment[0] += h[1] * local[2] - h[2] * local[1]
        moment[1] += h[2] * local[0] - h[0] * local[2]
        moment[2] += h[0] * local[1] - h[1] * local[0]
        for k in range(13):
            g[3 + k] += J[f, 0, k] * local[0] + J[f, 1, k] * local[1] + J[f, 2, k] * local[2]
    for a in range(3):
        g[a] = Jr[0, a] * moment[0] + Jr[1, a] * moment[1] + Jr[2, a] * moment[2]


@compiled
def constraint_curvature(
    tables: HandTables,
    nominal: Nominal,
    d: Matrix,
    frames: Matrix,
    origins: Matrix,
    tips: Matrix,
    J: Matrix,
    force: Matrix,
    H: Matrix,
) -> None:
    """Write H = sum_i force_i d2c_i/dd2 (19, 19), with frames, tips and J as left by `tip_constraint` at d.

    The joint block is exact: z_a x (z_b x r_b) for joint a before joint b; the three rotation columns are
    central differences of the analytic gradient (error about 1e-10).
    """
    H[:] = 0.0
    E, Jr = np.empty((3, 3)), np.empty((3, 3))
    rotation_and_jacobian(d[3:6], E, Jr)
    R = mat_mat(nominal.R, E)
    for n in range(nominal.fingers.shape[0]):
        f = nominal.fingers[n]
        local = mat_t_vec(R, force[3 * n : 3 * n + 3])
        b = tables.tip_part[f]
        while b > 0:
            zb = tables.sign[b - 1] * frames[b, :, 2]
            w = np.cross(zb, tips[f] - origins[b])
            kb = 6 + tables.drive[b - 1]
            a = b
            while a > 0:
                value = tables.sign[a - 1] * np.sum(local * np.cross(frames[a, :, 2], w))
                ka = 6 + tables.drive[a - 1]
                H[ka, kb] += value
                if a != b:
                    H[kb, ka] += value
                a = tables.parent[a - 1]
            b = tables.parent[b - 1]
    step = 1e-5
    plus, minus, phi = np.empty(16), np.empty(16), d[3:6].copy()
    for k in range(3):
        phi[k] = d[3 + k] + step
        _gradient(nominal, phi, tips, J, force, plus)
        phi[k] = d[3 + k] - step
        _gradient(nominal, phi, tips, J, force, minus)
        phi[k] = d[3 + k]
        column = (plus - minus) / (2.0 * step)
        H[3:, 3 + k] = column
        H[3 + k, 6:] = column[3:]
