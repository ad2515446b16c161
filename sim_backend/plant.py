"""What hangs on simulated joint modules: drives to command, sensors to read, and a time that only steps move."""

from __future__ import annotations

from typing import Protocol

from preshape.sim_backend.drives import JointDrives
from preshape.sim_backend.joint_sensors import JointSensors
from preshape.sim_backend.simulation import Hook


class Plant(Protocol):
    """Forty joints in physics: the whole scene (`Simulation`) or the robot alone (`BareRobot`)."""

    drives: JointDrives
    joint_sensors: JointSensors
    time_ns: int
    before_step: list[Hook]
    after_step: list[Hook]

    def step(self, count: int = 1) -> None:
        """Advance by a number of steps of a millisecond."""
        ...
