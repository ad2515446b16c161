"""The joint modules' drives: targets interpolated between commands, a torque clip, and what each mode does."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.state import Vector

LEAD_FILTER_S = 0.008
"""Time constant of the arms' commanded velocity, s."""


class JointDrives:
    """Drives of all 40 joints of one model; `apply` runs before every physics step.

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
        self._velocity = np.zeros(LAYOUT.dof)
        self._timestep = float(model.opt.timestep)
        self._target = np.zeros(LAYOUT.dof)
        self._rows = np.zeros((0, LAYOUT.dof))
        self._row = 0
        self.max_requested_ratio = 0.0
        """Largest torque limit or torque ever asked for, as a share of the joint's own limit."""

    def apply(self) -> None:
        """Write this step's targets."""
        if self._row < len(self._rows):
            self._ctrl[:] = self._rows[self._row]
            self._row += 1
        elif self._row == len(self._rows):
            self._ctrl[:] = self._target
            self._row += 1

    def follow(self, position: Vector, torque_limit: Vector, period_s: float) -> None:
        """Move the target to a position (40,) within a period, with at most the given torques (40,)."""
        self._note_request(torque_limit)
        self._set_servo(torque_limit)
        count = max(1, round(period_s / self._timestep))
        start = self._reached()
        share = (np.arange(count) + 1.0) / count
        travel = position - start
        duration_s = count * self._timestep
        self._velocity += (1.0 - np.exp(-duration_s / LEAD_FILTER_S)) * (travel / duration_s - self._velocity)
        # The drive damps the error of velocity, not velocity itself: its target carries the lead d/k v.
        self._rows = start + share[:, None] * travel + self._lead * self._velocity
        self._starts, self._count = start, count
        self._target, self._row = np.array(position), 0

    def hold(self, position: Vector, torque_limit: Vector) -> None:
        """Rest at a position (40,) from now on: the drive's stiffness and damping, no interpolation."""
        self._set_servo(torque_limit)
        self._rest_at(position)

    def push(self, torque: Vector, torque_limit: Vector) -> None:
        """Apply torques (40,), clipped, without any position loop; the mechanical damping remains."""
        self._note_request(torque_limit)
        self._gain[:, 0], self._bias[:, 1], self._bias[:, 2] = 1.0, 0.0, 0.0
        self._clip_at(torque_limit)
        self._rest_at(torque)

    def release(self) -> None:
        """Switch the drives off; gravity compensation alone remains."""
        self.push(np.zeros(LAYOUT.dof), np.zeros(LAYOUT.dof))

    def _reached(self) -> Vector:
        """Return the interpolated target at this moment, without the lead."""
        if not len(self._rows) or self._row >= len(self._rows):
            return self._target
        return self._starts + (self._target - self._starts) * (self._row / self._count)

    def _rest_at(self, values: ArrayLike) -> None:
        self._target = np.array(values, dtype=np.float64)
        self._rows, self._row = np.zeros((0, LAYOUT.dof)), 0
        self._velocity[:] = 0.0

    def _set_servo(self, torque_limit: Vector) -> None:
        self._gain[:, 0], self._bias[:, 1], self._bias[:, 2] = self._stiffness, -self._stiffness, -self._damping
        self._clip_at(torque_limit)

    def _clip_at(self, torque_limit: Vector) -> None:
        clip = np.clip(torque_limit, 0.0, LAYOUT.torque)
        self._range[:, 0], self._range[:, 1] = -clip, clip

    def _note_request(self, torque_limit: Vector) -> None:
        self.max_requested_ratio = max(self.max_requested_ratio, float(np.max(torque_limit / LAYOUT.torque)))
