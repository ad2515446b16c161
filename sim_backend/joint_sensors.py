"""What the joint modules measure: positions, filtered velocities and link-side torques, late, noisy, in counts."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from preshape.hal import sah_hand
from preshape.hal.compiled import compiled
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.sim_backend.robot_model import joint_addresses

Indices = NDArray[np.int64]

DELAY_STEPS = 1
"""Age of the newest sample that can be read, in physics steps."""
FILTER_S = 0.002
"""Time constant of the drives' velocity filter, s."""
ARM_POSITION_RESOLUTION = np.deg2rad(0.01)
FINGER_TORQUE_NOISE, ARM_TORQUE_NOISE = 0.005, 0.05
"""Standard deviation of the torque sensors' white noise, N m."""
ARM_TORQUE_RESOLUTION = 0.01
_NOISE_ROWS = 8192
"""The noise repeats after this many steps; a table makes it independent of who reads when."""


class JointSensors:
    """Samples all 40 joints every physics step; `read` returns them one step late with noise and in counts.

    The torque is what the link-side sensor truly carries: the drive's torque (gravity compensation included)
    less what the rotor's inertia and the joint's damping take, tau = tau_drive - J_rotor q'' - b q', with the
    mean acceleration of the step. A pip's sensor carries its coupled dip as well.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, seed: int) -> None:
        """Take a first sample of a model that has been brought to its first state; `seed` draws the noise."""
        self._velocity_before = data.qvel.copy()
        # Views of MuJoCo's own arrays, taken once: asking for them costs more than the sampling.
        self._scene = (
            data.qpos, data.qvel, self._velocity_before, data.qfrc_actuator, data.actuator_force,
            model.actuator_forcerange, model.actuator_biasprm, LAYOUT.torque, model.dof_armature, model.dof_damping,
            *joint_addresses(model), _coupled_dofs(model), float(model.opt.timestep),
            float(np.exp(-model.opt.timestep / FILTER_S)),
        )  # fmt: skip
        self._ring = np.zeros((DELAY_STEPS + 1, 3, LAYOUT.dof))
        self._is_arm = _arm_joints()
        rng = np.random.default_rng((0x70B9, seed))
        spread = np.where(self._is_arm, ARM_TORQUE_NOISE, FINGER_TORQUE_NOISE)
        self._noise = rng.standard_normal((_NOISE_ROWS, LAYOUT.dof)) * spread
        self._position_count = np.where(self._is_arm, ARM_POSITION_RESOLUTION, sah_hand.POSITION_RESOLUTION)
        self._torque_count = np.where(self._is_arm, ARM_TORQUE_RESOLUTION, sah_hand.TORQUE_RESOLUTION)
        self._torque_range = np.where(self._is_arm, np.inf, sah_hand.TORQUE_RANGE)
        self._frozen = np.zeros(LAYOUT.dof, dtype=bool)
        self._frozen_torque = np.zeros(LAYOUT.dof)
        self._steps = 0
        for _ in range(DELAY_STEPS + 1):
            self.update()
        self._steps = 0

    @property
    def true_torque(self) -> Vector:
        """Link-side torque (40,) of the step just made, N m, without noise: a view, for the referee."""
        return self._ring[self._steps % (DELAY_STEPS + 1), 2]

    def update(self) -> None:
        """Sample the step just made."""
        self._steps += 1
        slots = DELAY_STEPS + 1
        _sample(*self._scene, self._ring[(self._steps - 1) % slots], self._ring[self._steps % slots])

    def read(self) -> tuple[Vector, Vector, Vector]:
        """Return position (rad), velocity (rad/s) and torque (N m) of all joints, `DELAY_STEPS` steps old."""
        told = np.empty((3, LAYOUT.dof))
        _tell(
            self._ring[(self._steps + 1) % (DELAY_STEPS + 1)], self._noise[self._steps % _NOISE_ROWS],
            self._position_count, self._torque_count, self._torque_range, self._frozen, self._frozen_torque, told,
        )  # fmt: skip
        return told[0], told[1], told[2]

    def freeze_torque(self, joints: slice) -> None:
        """Break torque sensors: from now on they report their last value with a fresh stamp."""
        self._frozen_torque[joints] = self.read()[2][joints]
        self._frozen[joints] = True

    def mend_torque(self, joints: slice) -> None:
        """Undo `freeze_torque`."""
        self._frozen[joints] = False


def _arm_joints() -> NDArray[np.bool_]:
    is_arm = np.zeros(LAYOUT.dof, dtype=bool)
    for side in SIDES:
        is_arm[LAYOUT.arm(side)] = True
    return is_arm


def _coupled_dofs(model: mujoco.MjModel) -> NDArray[np.int64]:
    """Return for each actuated joint the dof of the joint coupled to it, -1 if there is none."""
    coupled = np.full(LAYOUT.dof, -1, dtype=np.int64)
    for side in SIDES:
        for joint in sah_hand.JOINTS:
            if joint.coupled_to is not None:
                index = LAYOUT.index(f"{side}_{joint.coupled_to}")
                coupled[index] = model.jnt_dofadr[model.joint(f"{side}_{joint.name}").id]
    return coupled


@compiled
def _sample(
    qpos: Vector, qvel: Vector, qvel_before: Vector, drive: Vector, actuator_force: Vector,
    clip: Matrix, bias: Matrix, most: Vector, armature: Vector, damping: Vector,
    qpos_index: Indices, dofs: Indices, coupled_dofs: Indices, dt: float, keep: float, last: Matrix, out: Matrix,
) -> None:  # fmt: skip
    """Write position, filtered velocity and link-side torque of each joint into `out` (3, n)."""
    for i in range(len(dofs)):
        dof = dofs[i]
        acceleration = (qvel[dof] - qvel_before[dof]) / dt
        torque = drive[dof] - armature[dof] * acceleration - damping[dof] * qvel[dof]
        # The integrator takes the drive's own damping at the end of the step, unless drive or joint is clipped.
        if clip[i, 0] < actuator_force[i] < clip[i, 1] and abs(drive[dof]) < most[i]:
            torque += dt * bias[i, 2] * acceleration
        other = coupled_dofs[i]
        if other >= 0:
            acceleration = (qvel[other] - qvel_before[other]) / dt
            torque += drive[other] - armature[other] * acceleration - damping[other] * qvel[other]
        out[0, i] = qpos[qpos_index[i]]
        out[1, i] = keep * last[1, i] + (1.0 - keep) * qvel[dof]
        out[2, i] = torque
    qvel_before[:] = qvel


@compiled
def _tell(
    sample: Matrix, noise: Vector, position_count: Vector, torque_count: Vector, torque_range: Vector,
    frozen: NDArray[np.bool_], frozen_torque: Vector, out: Matrix,
) -> None:  # fmt: skip
    """Write what the modules report of a sample (3, n) into `out` (3, n): counts, noise and range of the torque."""
    for i in range(sample.shape[1]):
        torque = np.rint((sample[2, i] + noise[i]) / torque_count[i]) * torque_count[i]
        if torque > torque_range[i]:
            torque = torque_range[i]
        elif torque < -torque_range[i]:
            torque = -torque_range[i]
        out[0, i] = np.rint(sample[0, i] / position_count[i]) * position_count[i]
        out[1, i] = sample[1, i]
        out[2, i] = frozen_torque[i] if frozen[i] else torque
