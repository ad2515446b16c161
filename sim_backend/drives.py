"""The joint modules' drives: targets interpolated between commands, a torque clip, and what each mode does."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.state import Vector

LEAD_FILTER_S = 0.008
"""Time constant of the arms' commanded velocity, s."""

Joints = slice | NDArray[np.int64]
"""Some of the joints, by their places in the layout."""
EVERY = slice(None)


class JointDrives:
    """Drives of all 40 joints of one model; `apply` runs before every physics step. Each joint keeps its own time.

    Position mode: tau = clip(k (p(t) - q) + d (v - q'), +- torque limit), with p(t) running linearly from the
    last target to the commanded one within one command period, then resting there. v is the commanded velocity,
    low-passed, for the arms, and 0 for the fingers: their targets carry the grip's torque loop, whose noise a
    velocity lead would amplify tenfold. To this the modules add gravity compensation of the robot itself; the
    sum is clipped at the joint's own limit (`LAYOUT.torque`).
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Take over the actuators, which stand in layout order; targets are whatever `hold` says first."""
        self._ctrl = data.ctrl
        self._gain, self._bias = model.actuator_gainprm, model.actuator_biasprm
        self._range = model.actuator_forcerange
        self._stiffness, self._damping = self._gain[:, 0].copy(), -self._bias[:, 2].copy()
        self._lead = self._damping / self._stiffness
        for side in SIDES:
            self._lead[LAYOUT.hand(side)] = 0.0
        self._timestep = float(model.opt.timestep)
        # Per joint: on step `row` of `count` from `start` by `travel` to `target`; afterwards it rests there.
        self._start, self._travel, self._target = np.zeros((3, LAYOUT.dof))
        self._velocity, self._offset = np.zeros((2, LAYOUT.dof))
        self._row, self._count = np.zeros((2, LAYOUT.dof))
        self._moving = False
        self.max_requested_ratio = 0.0
        """Largest torque limit or torque ever asked for, as a share of the joint's own limit."""

    def apply(self) -> None:
        """Write this step's targets."""
        if not self._moving:
            return
        on_the_way = self._row < self._count
        self._row += 1.0
        share = self._row / np.maximum(self._count, 1.0)
        np.copyto(self._ctrl, np.where(on_the_way, self._start + share * self._travel + self._offset, self._target))
        self._moving = bool(on_the_way.any())

    def follow(self, position: Vector, torque_limit: Vector, period_s: float, joints: Joints = EVERY) -> None:
        """Move the targets of some joints to positions (n,) within a period, with at most the given torques (n,)."""
        self._note_request(torque_limit, joints)
        self._set_servo(torque_limit, joints)
        count = max(1, round(period_s / self._timestep))
        start = self._reached(joints)
        travel = position - start
        duration_s = count * self._timestep
        keep = 1.0 - np.exp(-duration_s / LEAD_FILTER_S)
        self._velocity[joints] += keep * (travel / duration_s - self._velocity[joints])
        # The drive damps the error of velocity, not velocity itself: its target carries the lead d/k v.
        self._offset[joints] = self._lead[joints] * self._velocity[joints]
        self._start[joints], self._travel[joints], self._target[joints] = start, travel, position
        self._row[joints], self._count[joints] = 0.0, count
        self._moving = True

    def hold(self, position: Vector, torque_limit: Vector, joints: Joints = EVERY) -> None:
        """Rest some joints at positions (n,) from now on: the drive's stiffness and damping, no interpolation."""
        self._set_servo(torque_limit, joints)
        self._rest_at(position, joints)

    def push(self, torque: Vector, torque_limit: Vector, joints: Joints = EVERY) -> None:
        """Apply torques (n,), clipped, without any position loop; the mechanical damping remains."""
        self._note_request(torque_limit, joints)
        self._gain[joints, 0], self._bias[joints, 1], self._bias[joints, 2] = 1.0, 0.0, 0.0
        self._clip_at(torque_limit, joints)
        self._rest_at(torque, joints)

    def release(self, joints: Joints = EVERY) -> None:
        """Switch some joints' drives off; gravity compensation alone remains."""
        nothing = np.zeros(len(self._target[joints]))
        self.push(nothing, nothing, joints)

    def scale_gains(self, stiffness: Vector, damping: Vector, joints: Joints) -> None:
        """Set the position loops' gains of some joints, N m/rad and N m s/rad (n,), from their next command on."""
        self._stiffness[joints], self._damping[joints] = stiffness, damping
        self._lead[joints] = np.where(self._lead[joints] > 0.0, damping / stiffness, 0.0)

    def gains(self, joints: Joints) -> tuple[Vector, Vector]:
        """Return stiffness (N m/rad) and damping (N m s/rad) of some joints' position loops."""
        return self._stiffness[joints].copy(), self._damping[joints].copy()

    def _reached(self, joints: Joints) -> Vector:
        """Return the interpolated targets at this moment, without the lead."""
        row, count, target = self._row[joints], self._count[joints], self._target[joints]
        start = self._start[joints]
        return np.where(row < count, start + (target - start) * (row / np.maximum(count, 1.0)), target)

    def _rest_at(self, values: ArrayLike, joints: Joints) -> None:
        self._target[joints] = values
        self._row[joints], self._count[joints] = 0.0, 0.0
        self._velocity[joints] = 0.0
        self._moving = True

    def _set_servo(self, torque_limit: Vector, joints: Joints) -> None:
        stiffness, damping = self._stiffness[joints], self._damping[joints]
        self._gain[joints, 0], self._bias[joints, 1], self._bias[joints, 2] = stiffness, -stiffness, -damping
        self._clip_at(torque_limit, joints)

    def _clip_at(self, torque_limit: Vector, joints: Joints) -> None:
        clip = np.clip(torque_limit, 0.0, LAYOUT.torque[joints])
        self._range[joints, 0], self._range[joints, 1] = -clip, clip

    def _note_request(self, torque_limit: Vector, joints: Joints) -> None:
        ratio = float(np.max(torque_limit / LAYOUT.torque[joints]))
        self.max_requested_ratio = max(self.max_requested_ratio, ratio)
