"""The physics of one drawn scenario, stepped one millisecond at a time: robot, box that tears, obstacles, kicks."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, cross
from preshape.sim_backend.drives import JointDrives
from preshape.sim_backend.joint_sensors import DELAY_STEPS, JointSensors
from preshape.sim_backend.moving_obstacles import MovingObstacles
from preshape.sim_backend.robot_model import joint_addresses
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import TIMESTEP_S, build_scene
from preshape.sim_backend.sensor_faults import SensorFaults
from preshape.sim_backend.tearing import Tearing

STEP_NS = round(TIMESTEP_S * 1e9)

RIGHT_ARM_HOME = (-1.372, -0.859, 1.185, -2.359, 0.814, 1.836, -0.890)
"""Right arm at rest, rad: the palm at (.45, -.40, .50), pointing down; the left arm is its mirror image."""
_MIRRORED = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])

Hook = Callable[[int], None]
"""Called with a time in ns, once a step."""


def home_position() -> Vector:
    """Return the joints (40,) at the start: arms at home, hands open and straight."""
    home = np.zeros(LAYOUT.dof)
    home[LAYOUT.arm("right")] = RIGHT_ARM_HOME
    home[LAYOUT.arm("left")] = _MIRRORED * RIGHT_ARM_HOME
    for side in SIDES:
        home[LAYOUT.hand(side)] = np.clip(0.0, LAYOUT.lower[LAYOUT.hand(side)], LAYOUT.upper[LAYOUT.hand(side)])
    return home


class Simulation:
    """One world: build -> `step` -> look. Same scenario, same commands: same bytes.

    A step from t to t + 1 ms calls the hooks `before_step` with t, moves everything, then calls `after_step` with
    t as well: contacts, body poses and torques in `data` are then those at t, joint positions those at t + 1 ms.
    """

    def __init__(self, scenario: Scenario, start_ns: int = 0, home: Vector | None = None) -> None:
        """Build a drawn scenario (`Scenario.drawn`); times count from `start_ns`, arms start at `home` (40,)."""
        self.scenario = scenario
        self.model = build_scene(scenario)
        self.data = mujoco.MjData(self.model)
        self.start_ns = self.time_ns = start_ns
        self.before_step: list[Hook] = []
        self.after_step: list[Hook] = []
        self._box = self.model.body("box").id
        self._kick_steps = 0
        self._set_joints(home_position() if home is None else home)
        self.obstacles = MovingObstacles(self.model, self.data, scenario.obstacles)
        mujoco.mj_forward(self.model, self.data)
        self.drives = JointDrives(self.model, self.data)
        self.drives.hold(self.data.ctrl.copy(), LAYOUT.torque)
        self.joint_sensors = JointSensors(self.model, self.data, scenario.seed)
        self._faults = SensorFaults(self.joint_sensors, scenario.disturbances.frozen)
        self.tearing = Tearing(self.model, scenario) if _has_lid(self.model) else None

    @property
    def seconds(self) -> float:
        """Simulated time since the start, s."""
        return (self.time_ns - self.start_ns) * 1e-9

    @property
    def sample_ns(self) -> int:
        """When the joint sample that can be read now was taken, ns."""
        return self.time_ns - DELAY_STEPS * STEP_NS

    @property
    def X_world_box(self) -> Matrix:
        """True pose of the box's frame."""
        X = np.eye(4)
        X[:3, :3], X[:3, 3] = self.data.xmat[self._box].reshape(3, 3), self.data.xpos[self._box]
        return X

    def step(self, count: int = 1) -> None:
        """Advance by a number of physics steps."""
        for _ in range(count):
            self._step()

    def kick(self, force: ArrayLike, duration_s: float) -> None:
        """Push at the box's centre with a force (3,), N, in the world's frame, from now on for a while."""
        force = np.asarray(force, dtype=np.float64)
        lever = self.data.xpos[self._box] - self.data.xipos[self._box]
        self.data.xfrc_applied[self._box, :3] = force
        self.data.xfrc_applied[self._box, 3:] = cross(lever, force)
        self._kick_steps = max(1, round(duration_s / TIMESTEP_S))

    def _step(self) -> None:
        time_ns = self.time_ns
        for hook in self.before_step:
            hook(time_ns)
        self.drives.apply()
        if self.obstacles.any:
            self.obstacles.place((time_ns - self.start_ns) * 1e-9)
        mujoco.mj_step(self.model, self.data)
        self.time_ns = time_ns + STEP_NS
        if self.tearing is not None:
            self.tearing.update(self.data)
        self.joint_sensors.update()
        self._faults.look(self.seconds)
        for hook in self.after_step:
            hook(time_ns)
        if self._kick_steps:
            self._kick_steps -= 1
            if not self._kick_steps:
                self.data.xfrc_applied[self._box] = 0.0

    def _set_joints(self, position: Vector) -> None:
        model, data = self.model, self.data
        data.qpos[joint_addresses(model)[0]] = position
        data.ctrl[:] = position
        for equality in range(model.neq):
            first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
            if second >= 0:
                data.qpos[model.jnt_qposadr[first]] = data.qpos[model.jnt_qposadr[second]]


def _has_lid(model: mujoco.MjModel) -> bool:
    return any(model.eq(number).name == "lid_perforation" for number in range(model.neq))
