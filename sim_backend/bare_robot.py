"""The robot alone in empty space: rigid-body dynamics with drives and sensors, nothing to touch."""

from __future__ import annotations

import mujoco
import numpy as np

from preshape.hal.description import ARM_BASE
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.transform import transform
from preshape.sim_backend.drives import JointDrives
from preshape.sim_backend.joint_sensors import JointSensors
from preshape.sim_backend.robot_model import joint_addresses, robot_spec
from preshape.sim_backend.scene import TIMESTEP_S
from preshape.sim_backend.simulation import STEP_NS, Hook, home_position


class BareRobot:
    """`preshape.sim_backend.plant.Plant` without a scene; contacts are switched off."""

    def __init__(self, seed: int = 0, start_ns: int = 0) -> None:
        """Build the robot at its home position; `seed` draws the sensors' noise, times count from `start_ns`."""
        spec = robot_spec({side: transform(ARM_BASE[side]) for side in SIDES})
        spec.option.timestep = TIMESTEP_S
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.time_ns = start_ns
        self.before_step: list[Hook] = []
        self.after_step: list[Hook] = []
        self._set_home()
        mujoco.mj_forward(self.model, self.data)
        self.drives = JointDrives(self.model, self.data)
        self.drives.hold(self.data.ctrl.copy(), LAYOUT.torque)
        self.joint_sensors = JointSensors(self.model, self.data, seed)

    @property
    def position(self) -> np.ndarray:
        """True positions (40,), rad, without noise or delay."""
        return self.data.qpos[joint_addresses(self.model)[0]]

    def step(self, count: int = 1) -> None:
        """Advance by a number of steps of a millisecond."""
        for _ in range(count):
            time_ns = self.time_ns
            for hook in self.before_step:
                hook(time_ns)
            self.drives.apply()
            mujoco.mj_step(self.model, self.data)
            self.time_ns = time_ns + STEP_NS
            self.joint_sensors.update()
            for hook in self.after_step:
                hook(time_ns)

    def _set_home(self) -> None:
        model, data, home = self.model, self.data, home_position()
        data.qpos[joint_addresses(model)[0]] = home
        data.ctrl[:] = home
        for equality in range(model.neq):
            first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
            if second >= 0:
                data.qpos[model.jnt_qposadr[first]] = data.qpos[model.jnt_qposadr[second]]
