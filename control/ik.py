"""Whole-body inverse kinematics of both arms in one quadratic program a tick (PlaCo).

    min over dq  sum over palms of w_p |J_p dq - e_p|^2 + w_o |J_o dq - e_o|^2  +  w_q |dq - r dt (q_n - q)|^2
    subject to   lower <= q + dq <= upper,  |dq| <= V dt,  forearms apart (soft),

with e_p, e_o the position (m) and rotation (rad) errors of a palm, q_n a nominal posture that the
redundant joint drifts to at the rate r (1/s). The program is solved from the last *command*.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import placo  # pyright: ignore[reportMissingImports]
from numpy.typing import ArrayLike

from preshape.hal.compiled import compiled
from preshape.hal.description import ARM_BASE, robot_urdf
from preshape.hal.layout import ARM_DOF, LAYOUT, SIDES, Side, arm_joint_names
from preshape.hal.transform import Matrix, transform
from preshape.planner.arm_kinematics import FRAME_COUNT, PALM, chain_frames, link_origins, mount

ARMS_DOF = ARM_DOF * len(SIDES)
JOINT_NAMES = tuple(name for side in SIDES for name in arm_joint_names(side))
"""Joints of every (14,) vector here: right arm, left arm."""

FOREARMS = (4, 5, 7)
"""Links of one arm compared with the same links of the other: 9 pairs. Hands are the vector field's affair."""


class IkStatus(IntEnum):
    """How a step ended: the palms are at their targets, on the way, or the step was refused."""

    REACHED = 0
    MOVING = 1
    INFEASIBLE = 2
    BAD_TARGET = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class IkConfig:
    """Weights and limits of the quadratic program.

    Attributes:
        position_weight: per m^2.
        rotation_weight: per rad^2.
        posture_weight: per rad^2; also damps the step near singular postures.
        posture_rate: share of the way to the nominal posture taken per second, 1/s.
        posture_speed: largest speed of the drift to the nominal posture, rad/s.
        limit_margin: distance kept from the joint limits, rad.
        speed_ratio: share of the joint velocity limits that may be used.
        forearm_gap: distance kept between the forearms, m.
        position_tolerance: a palm nearer than this (m) and ...
        rotation_tolerance: ... turned by less than this (rad) has REACHED its target.
    """

    position_weight: float = 20.0
    rotation_weight: float = 1.0
    posture_weight: float = 1e-4
    posture_rate: float = 1.0
    posture_speed: float = 0.3
    limit_margin: float = 0.01
    speed_ratio: float = 0.95
    forearm_gap: float = 0.02
    position_tolerance: float = 1e-3
    rotation_tolerance: float = 5e-3


@dataclass(frozen=True, slots=True, eq=False)
class IkStep:
    """The next command q (14), rad, and what is left afterwards, right then left: errors in m and rad.

    INFEASIBLE and BAD_TARGET leave q at the command that came in; the errors are NaN then.
    """

    status: IkStatus
    q: Matrix
    position_error: tuple[float, float] = (np.nan, np.nan)
    rotation_error: tuple[float, float] = (np.nan, np.nan)


def _load_robot(X_world_base: Mapping[Side, Matrix]) -> Any:
    """Return PlaCo's model of the arms without hands, its collision pairs being the forearms."""
    pairs = [[f"right_arm_link{a}", f"left_arm_link{b}"] for a in FOREARMS for b in FOREARMS]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "robot.urdf").write_text(robot_urdf(X_world_base, hands=False))
        Path(folder, "collisions.json").write_text(json.dumps(pairs))
        return placo.RobotWrapper(str(Path(folder, "robot.urdf")))


class ArmIk:
    """The solver; holds PlaCo's robot and tasks, so one per thread. All joint vectors are (14,), right then left."""

    def __init__(self, X_world_base: Mapping[Side, Matrix] | None = None, config: IkConfig | None = None) -> None:
        self.config = config or IkConfig()
        bases = X_world_base or {side: transform(ARM_BASE[side]) for side in SIDES}
        self._bases = [np.ascontiguousarray(bases[side]) for side in SIDES]
        rows = np.concatenate([np.arange(LAYOUT.dof)[LAYOUT.arm(side)] for side in SIDES])
        self.lower = LAYOUT.lower[rows] + self.config.limit_margin
        self.upper = LAYOUT.upper[rows] - self.config.limit_margin
        self._robot = _load_robot(bases)
        self._offsets = np.array([self._robot.get_joint_offset(name) for name in JOINT_NAMES])
        self._dofs = self._offsets - 1
        self._q_all: Matrix = self._robot.state.q.copy()
        for name, lower, upper, speed in zip(JOINT_NAMES, self.lower, self.upper, LAYOUT.velocity[rows], strict=True):
            self._robot.set_joint_limits(name, lower, upper)
            self._robot.set_velocity_limit(name, speed * self.config.speed_ratio)
        self._nominal = 0.5 * (self.lower + self.upper)
        self._hurry = 1.0
        self._frames = np.empty((FRAME_COUNT, 4, 4))
        self._build_solver()
        # The first call loads compiled code, which must not happen inside a tick.
        self.solve(self._nominal, np.eye(4), np.eye(4), 1e-3)

    def _build_solver(self) -> None:
        config = self.config
        solver: Any = placo.KinematicsSolver(self._robot)
        solver.mask_fbase(True)
        solver.enable_joint_limits(True)
        solver.enable_velocity_limits(True)
        self._position_tasks: list[Any] = []
        self._rotation_tasks: list[Any] = []
        for side in SIDES:
            position = solver.add_position_task(f"{side}_palm", np.zeros(3))
            position.configure(f"{side} palm position", "soft", config.position_weight)
            rotation = solver.add_orientation_task(f"{side}_palm", np.eye(3))
            rotation.configure(f"{side} palm rotation", "soft", config.rotation_weight)
            self._position_tasks.append(position)
            self._rotation_tasks.append(rotation)
        self._posture: Any = solver.add_joints_task()
        self._posture.configure("posture", "soft", config.posture_weight)
        apart = solver.add_avoid_self_collisions_constraint()
        apart.self_collisions_margin = config.forearm_gap
        apart.self_collisions_trigger = config.forearm_gap + 0.03
        # Soft: a start nearer than the gap must not make the program infeasible.
        apart.configure("forearms apart", "soft", 1e3)
        self._solver = solver

    def set_nominal(self, q: ArrayLike, hurry: float = 1.0) -> None:
        """Choose the posture (14), rad, that the redundancy drifts to; `hurry` is a factor on rate and speed."""
        self._nominal = np.clip(_arms_vector(q), self.lower, self.upper)
        self._hurry = hurry

    def solve(self, q_command: ArrayLike, X_world_palm_right: Matrix, X_world_palm_left: Matrix, dt: float) -> IkStep:
        """Return the command one period dt (s) after q_command (14), rad, towards both palm targets (4x4).

        A command outside the limits is clamped first: outside by more than V dt the program has no solution.

        Raises:
            ValueError: q_command has another shape or is not finite, or dt is not positive.
        """
        if dt <= 0.0:
            raise ValueError(f"dt: got {dt} s, allowed is > 0")
        given = _arms_vector(q_command)
        targets = (X_world_palm_right, X_world_palm_left)
        if not (np.isfinite(X_world_palm_right).all() and np.isfinite(X_world_palm_left).all()):
            return IkStep(IkStatus.BAD_TARGET, given)
        q = np.minimum(np.maximum(given, self.lower), self.upper)
        self._write_targets(q, targets, dt)
        try:
            displacement = self._solver.solve(False)
        except RuntimeError as error:
            if "QPError" not in str(error):
                raise
            return IkStep(IkStatus.INFEASIBLE, given)
        q = np.minimum(np.maximum(q + displacement[self._dofs], self.lower), self.upper)
        return self._judged(q, targets)

    def _write_targets(self, q: Matrix, targets: tuple[Matrix, Matrix], dt: float) -> None:
        self._q_all[self._offsets] = q
        self._robot.state.q = self._q_all
        self._robot.update_kinematics()
        self._solver.dt = dt
        for k, X in enumerate(targets):
            self._position_tasks[k].target_world = X[:3, 3]
            self._rotation_tasks[k].R_world_frame = X[:3, :3]
        most = self._hurry * self.config.posture_speed
        speed = np.minimum(np.maximum(self._hurry * self.config.posture_rate * (self._nominal - q), -most), most)
        self._posture.set_joints(dict(zip(JOINT_NAMES, (q + dt * speed).tolist(), strict=True)))

    def _judged(self, q: Matrix, targets: tuple[Matrix, Matrix]) -> IkStep:
        (p_right, r_right), (p_left, r_left) = (self._errors(k, q, X) for k, X in enumerate(targets))
        reached = (
            max(p_right, p_left) <= self.config.position_tolerance
            and max(r_right, r_left) <= self.config.rotation_tolerance
        )
        return IkStep(IkStatus.REACHED if reached else IkStatus.MOVING, q, (p_right, p_left), (r_right, r_left))

    def _errors(self, arm: int, q: Matrix, X_world_target: Matrix) -> tuple[float, float]:
        """Return distance (m) and angle (rad) of one palm to its target."""
        joints = q[arm * ARM_DOF : (arm + 1) * ARM_DOF]
        chain_frames(link_origins(), self._bases[arm], mount(SIDES[arm]), joints, self._frames)
        return _pose_error(self._frames[PALM], X_world_target)


@compiled
def _pose_error(X_a: Matrix, X_b: Matrix) -> tuple[float, float]:
    """Return the distance (m) and the angle (rad) between two poses; |R - R'|_F = sqrt(8) sin(angle / 2)."""
    way = chord = 0.0
    for row in range(3):
        way += (X_a[row, 3] - X_b[row, 3]) ** 2
        for column in range(3):
            chord += (X_a[row, column] - X_b[row, column]) ** 2
    return math.sqrt(way), 2.0 * math.asin(min(1.0, math.sqrt(chord / 8.0)))


def _arms_vector(q: ArrayLike) -> Matrix:
    q = np.array(q, dtype=float)
    if q.shape != (ARMS_DOF,) or not np.isfinite(q).all():
        raise ValueError(f"arm joints: got shape {q.shape}, allowed are ({ARMS_DOF},) finite values")
    return q
