"""All joint solutions of an arm for a palm pose, in closed form for each angle of joint 7.

Notation: frame k is link k's, S the shoulder (joints 1-3 meet), E the elbow (origin of frame 4), W the
wrist (joints 5, 6 meet); d3, d5 upper arm and forearm along z, a the elbow's offset, b the wrist's.

1. q7 gives frame 6: R6 = R7 Rz(-q7) Rx(-roll7), W = p7 - b x6.
2. |W - S| gives q4 (law of cosines in the plane of S, E, W; two signs).
3. y4 = z5 = sin(q6) x6 + cos(q6) y6 and (S - W).y4 is known from q4: two q6.
4. x4 = ((S - W) - ((S - W).y4) y4) / ((S - W).x4), so R4; then R5 gives q5 and
   R3 = Rz(q1) Ry(q2) Rz(q3) gives q1, q2, q3 (two signs of q2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preshape.hal import panda_arm
from preshape.hal.compiled import compiled
from preshape.hal.layout import ARM_DOF, LAYOUT, Side
from preshape.hal.transform import Matrix, inverse
from preshape.planner.arm_kinematics import mount

D1 = panda_arm.JOINTS[0].xyz[2]
D3 = -panda_arm.JOINTS[2].xyz[1]
A4 = panda_arm.JOINTS[3].xyz[0]
D5 = panda_arm.JOINTS[4].xyz[1]
B7 = panda_arm.JOINTS[6].xyz[0]

BRANCHES = 8
"""Most solutions for one q7: two signs each of the elbow (q4), the wrist (q6) and the shoulder (q2)."""

SINGULAR = 1e-7
"""Below this sine or length (m) a branch is singular and left out: its neighbours in q7 stand for it."""


@dataclass(frozen=True, slots=True)
class IkGrid:
    """How the redundancy is sampled: number of q7 values over the limits, and the margin to every limit, rad."""

    q7_samples: int = 121
    margin: float = float(np.deg2rad(2.0))

    def __post_init__(self) -> None:
        if self.q7_samples < 2:
            raise ValueError(f"q7_samples: got {self.q7_samples}, allowed is >= 2")
        if not 0.0 <= self.margin < 1.4:
            raise ValueError(f"margin: got {self.margin} rad, allowed is 0 .. 1.4")


@compiled
def _wrap(angle: float, lower: float) -> float:
    """Return the angle moved by whole turns into [lower, lower + 2 pi)."""
    turn = 2.0 * np.pi
    return angle - turn * np.floor((angle - lower) / turn)


@compiled
def _cross(a: Matrix, b: Matrix) -> Matrix:
    out = np.empty(3)
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return out


@compiled
def _shoulder(R3: Matrix, sign: float, q: Matrix) -> bool:
    """Write q1, q2, q3 of R3 = Rz(q1) Ry(q2) Rz(q3) with the given sign of q2; False where q2 = 0 leaves q1 open."""
    sine = np.hypot(R3[0, 2], R3[1, 2])
    if sine < SINGULAR:
        return False
    q[0] = np.arctan2(sign * R3[1, 2], sign * R3[0, 2])
    q[1] = np.arctan2(sign * sine, R3[2, 2])
    q[2] = np.arctan2(sign * R3[2, 1], -sign * R3[2, 0])
    return True


@compiled
def _elbow_frame(
    R6: Matrix, q4: float, q6: float, SW: Matrix, along: float, across: float, q: Matrix, R3: Matrix
) -> None:
    """Write q[3:6] and R3 for one elbow and one wrist branch (steps 3 and 4 of the module's notes)."""
    y4 = np.sin(q6) * R6[:, 0] + np.cos(q6) * R6[:, 1]
    x4 = (SW - along * y4) / across
    z4 = _cross(x4, y4)
    # Frame 5: z5 = y4; y5 = -z6 and x5 = y5 x z5. At q5 = 0 it is x4, -z4, y4.
    x5 = _cross(y4, R6[:, 2])
    q[4] = np.arctan2(-np.dot(x5, z4), np.dot(x5, x4))
    q[3], q[5] = q4, q6
    # R4 = R3 Rx(90) Rz(q4): undo both.
    c, s = np.cos(q4), np.sin(q4)
    R3[:, 0] = c * x4 - s * y4
    R3[:, 2] = s * x4 + c * y4
    R3[:, 1] = -z4


@compiled
def _wrist(X_base_link7: Matrix, q7: float, R6: Matrix, SW: Matrix) -> None:
    """Write R6 (step 1) and S - W, both in the base frame; Rz(-q7) Rx(-90) maps columns (x, y, z) to (x, -z, y)."""
    c7, s7 = np.cos(q7), np.sin(q7)
    for i in range(3):
        R6[i, 0] = c7 * X_base_link7[i, 0] - s7 * X_base_link7[i, 1]
        R6[i, 2] = s7 * X_base_link7[i, 0] + c7 * X_base_link7[i, 1]
        R6[i, 1] = -X_base_link7[i, 2]
        SW[i] = B7 * R6[i, 0] - X_base_link7[i, 3]
    SW[2] += D1


@compiled
def _shoulder_branches(q: Matrix, R3: Matrix, lower: Matrix, upper: Matrix, out: Matrix) -> int:
    """Write q with both shoulders that lie within the limits into out; return their number."""
    count = 0
    for branch in range(2):
        if not _shoulder(R3, 1.0 if branch == 0 else -1.0, q):
            continue
        if (q[:3] < lower[:3]).any() or (q[:3] > upper[:3]).any():
            continue
        out[count] = q
        count += 1
    return count


@compiled
def solve_fixed_q7(X_base_link7: Matrix, q7: float, lower: Matrix, upper: Matrix, out: Matrix) -> int:
    """Write the solutions within [lower, upper] for one q7 into out (8, 7); return their number."""
    R6, R3, SW, q = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(ARM_DOF)
    _wrist(X_base_link7, q7, R6, SW)
    upper_arm2, forearm2 = D3 * D3 + A4 * A4, D5 * D5 + A4 * A4
    cosine = (upper_arm2 + forearm2 - np.dot(SW, SW)) / (2.0 * np.sqrt(upper_arm2 * forearm2))
    if abs(cosine) > 1.0:
        return 0
    opening = np.arccos(cosine)
    # Directions of S - E at (-a, -d3) in (x3, z3) and of W - E at (-a, d5) in (x4, y4).
    aligned = np.arctan2(-D3, -A4) - np.arctan2(D5, -A4)
    sx, sy = np.dot(SW, np.ascontiguousarray(R6[:, 0])), np.dot(SW, np.ascontiguousarray(R6[:, 1]))
    radius = np.hypot(sx, sy)
    count = 0
    q[6] = q7
    for elbow in range(2):
        q4 = _wrap(aligned + (opening if elbow == 0 else -opening), -np.pi)
        if q4 < lower[3] or q4 > upper[3]:
            continue
        # S - W in (x4, y4): S - E turned by -q4, less W - E.
        across = A4 - A4 * np.cos(q4) - D3 * np.sin(q4)
        along = A4 * np.sin(q4) - D3 * np.cos(q4) - D5
        if abs(across) < SINGULAR or radius < SINGULAR or abs(along) > radius:
            continue
        swing = np.arccos(along / radius)
        for wrist in range(2):
            q6 = _wrap(np.arctan2(sx, sy) + (swing if wrist == 0 else -swing), lower[5])
            if q6 > upper[5]:
                continue
            _elbow_frame(R6, q4, q6, SW, along, across, q, R3)
            if lower[4] <= q[4] <= upper[4]:
                count += _shoulder_branches(q, R3, lower, upper, out[count:])
    return count


@compiled
def solve_sweep(X_base_link7: Matrix, q7s: Matrix, lower: Matrix, upper: Matrix, out: Matrix) -> int:
    """Write the solutions of every q7 into out (8 len(q7s), 7); return their number."""
    count = 0
    for k in range(q7s.shape[0]):
        count += solve_fixed_q7(X_base_link7, q7s[k], lower, upper, out[count:])
    return count


def joint_range(margin: float = 0.0) -> tuple[Matrix, Matrix]:
    """Return lower and upper limits (7,) of an arm drawn in by a margin, rad."""
    arm = LAYOUT.arm("right")
    return LAYOUT.lower[arm] + margin, LAYOUT.upper[arm] - margin


def link7_pose(side: Side, X_world_base: Matrix, X_world_palm: Matrix) -> Matrix:
    """Return X_base_link7 that puts the palm at X_world_palm."""
    X = inverse(X_world_base) @ X_world_palm @ inverse(mount(side))
    if not np.isfinite(X).all():
        raise ValueError("X_world_palm: every entry must be finite")
    return np.ascontiguousarray(X)


def solve_palm(side: Side, X_world_base: Matrix, X_world_palm: Matrix, grid: IkGrid | None = None) -> Matrix:
    """Return all solutions (n, 7), rad, for the sampled q7 within the limits less the margin; n may be 0."""
    grid = grid or IkGrid()
    lower, upper = joint_range(grid.margin)
    q7s: Matrix = np.linspace(float(lower[6]), float(upper[6]), grid.q7_samples)
    out = np.empty((BRANCHES * grid.q7_samples, ARM_DOF))
    return out[: solve_sweep(link7_pose(side, X_world_base, X_world_palm), q7s, lower, upper, out)].copy()
