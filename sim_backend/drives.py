"""The joint modules' drives: targets interpolated between commands, a torque clip, and what each mode does."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal.compiled import compiled
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix

LEAD_FILTER_S = 0.008
"""Time constant of the arms' commanded velocity, s."""
COAST_PERIODS = 1.0
"""How long an arm's target goes on as it went when the next command is missing, command periods."""

Indices = NDArray[np.int64]
Joints = slice | Indices
"""Some of the joints, by their places in the layout."""
EVERY = slice(None)
_LAST_SHARE = 1.0 + COAST_PERIODS
_PLACES: Indices = np.arange(LAYOUT.dof)


class JointDrives:
    """Drives of all 40 joints of one model; `apply` runs before every physics step. Each joint keeps its own time.

    Position mode: tau = clip(k (p(t) - q) + d (v - q'), +- torque limit), with p(t) running linearly from the
    last target to the commanded one within one command period. v is the commanded velocity, low-passed, for the arms,
    and 0 for the fingers: their targets carry the grip's torque loop, whose noise a velocity lead would amplify
    tenfold. A finger then rests at its target; an arm coasts for one more period before it rests, so that a command
    that is lost or late does not make it stop and catch up. To this the modules add gravity compensation of the robot
    itself; the sum is clipped at the joint's own limit (`LAYOUT.torque`).
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
        self._moving = _step(
            self._lead, self._start, self._travel, self._offset, self._target, self._row, self._count, self._ctrl
        )

    def follow(self, position: Vector, torque_limit: Vector, period_s: float, joints: Joints = EVERY) -> None:
        """Move the targets of some joints to positions (n,) within a period, with at most the given torques (n,)."""
        self._note_request(self._set_servo(torque_limit, joints))
        count = max(1, round(period_s / self._timestep))
        duration_s = count * self._timestep
        _set_out(
            _PLACES[joints], position, count, duration_s, 1.0 - np.exp(-duration_s / LEAD_FILTER_S), self._lead,
            self._start, self._travel, self._target, self._velocity, self._offset, self._row, self._count,
        )  # fmt: skip
        self._moving = True

    def hold(self, position: Vector, torque_limit: Vector, joints: Joints = EVERY) -> None:
        """Rest some joints at positions (n,) from now on: the drive's stiffness and damping, no interpolation."""
        self._set_servo(torque_limit, joints)
        self._rest_at(position, joints)

    def push(self, torque: Vector, torque_limit: Vector, joints: Joints = EVERY) -> None:
        """Apply torques (n,), clipped, without any position loop; the mechanical damping remains."""
        self._gain[joints, 0], self._bias[joints, 1], self._bias[joints, 2] = 1.0, 0.0, 0.0
        self._note_request(self._clip_at(torque_limit, joints))
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

    @property
    def targets(self) -> Vector:
        """The interpolated targets (40,) of this moment, without the lead; rad where a joint is in position mode."""
        share = self._row / np.maximum(self._count, 1.0)
        return np.where(self._row != self._count, self._start + share * self._travel, self._target)

    def _rest_at(self, values: ArrayLike, joints: Joints) -> None:
        self._target[joints] = values
        self._row[joints], self._count[joints] = 0.0, 0.0
        self._velocity[joints] = 0.0
        self._moving = True

    def _set_servo(self, torque_limit: Vector, joints: Joints) -> float:
        _write_servo(_PLACES[joints], self._gain, self._bias, self._stiffness, self._damping)
        return self._clip_at(torque_limit, joints)

    def _clip_at(self, torque_limit: Vector, joints: Joints) -> float:
        """Clip some joints' torques; return the largest limit as a share of its joint's own."""
        return _write_clip(_PLACES[joints], self._range, torque_limit, LAYOUT.torque)

    def _note_request(self, ratio: float) -> None:
        self.max_requested_ratio = max(self.max_requested_ratio, ratio)


@compiled
def _step(
    lead: Vector, start: Vector, travel: Vector, offset: Vector, target: Vector, row: Vector, count: Vector,
    ctrl: Vector,
) -> bool:  # fmt: skip
    """Write each joint's target of its next step into `ctrl` (40,); tell whether any was on its way."""
    moving = False
    for j in range(len(ctrl)):
        if row[j] < count[j] * (_LAST_SHARE if lead[j] > 0.0 else 1.0):
            row[j] += 1.0
            ctrl[j] = start[j] + row[j] / max(count[j], 1.0) * travel[j] + offset[j]
            moving = True
        else:
            ctrl[j] = _reached(j, start, travel, target, row, count)
    return moving


@compiled
def _reached(j: int, start: Vector, travel: Vector, target: Vector, row: Vector, count: Vector) -> float:
    """Return where joint j's target is: on its way to the commanded one, there (or at rest), or beyond it."""
    return target[j] if row[j] == count[j] else start[j] + travel[j] * (row[j] / count[j])


@compiled
def _set_out(
    joints: Indices, position: Vector, steps: int, duration_s: float, share: float, lead: Vector,
    start: Vector, travel: Vector, target: Vector, velocity: Vector, offset: Vector, row: Vector, count: Vector,
) -> None:  # fmt: skip
    """Send joints from where their targets are at this moment to positions (n,), and filter their velocity.

    The drive damps the error of velocity, not velocity itself: its target carries the lead d/k v as an offset.
    """
    for k in range(len(joints)):
        j = joints[k]
        reached = _reached(j, start, travel, target, row, count)
        travel[j] = position[k] - reached
        velocity[j] += share * (travel[j] / duration_s - velocity[j])
        offset[j] = lead[j] * velocity[j]
        start[j], target[j] = reached, position[k]
        row[j], count[j] = 0.0, steps


@compiled
def _write_servo(joints: Indices, gain: Matrix, bias: Matrix, stiffness: Vector, damping: Vector) -> None:
    for j in joints:
        gain[j, 0], bias[j, 1], bias[j, 2] = stiffness[j], -stiffness[j], -damping[j]


@compiled
def _write_clip(joints: Indices, force_range: Matrix, torque_limit: Vector, most: Vector) -> float:
    """Write the clips (n,) into the actuators' ranges; return the largest of limit over the joint's own."""
    ratio = -np.inf
    for k in range(len(joints)):
        j = joints[k]
        ratio = max(ratio, torque_limit[k] / most[j])
        clip = min(max(torque_limit[k], 0.0), most[j])
        force_range[j, 0], force_range[j, 1] = -clip, clip
    return ratio
