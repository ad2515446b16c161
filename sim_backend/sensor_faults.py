"""Torque sensors that freeze at the times a scenario gives."""

from __future__ import annotations

from collections.abc import Sequence

from preshape.hal.layout import LAYOUT
from preshape.sim_backend.joint_sensors import JointSensors
from preshape.sim_backend.scenario import FrozenSection


class SensorFaults:
    """Freezes the sensors of a simulation when their time has come; `look` once a step."""

    def __init__(self, sensors: JointSensors, frozen: Sequence[FrozenSection]) -> None:
        """Take the faults to come; `KeyError` names a part that the robot has not."""
        self._sensors = sensors
        self._pending = sorted(((section.from_s, LAYOUT.part(section.part)) for section in frozen), key=_time)

    def look(self, seconds: float) -> None:
        """Freeze what is due at a time since the start, s."""
        while self._pending and seconds >= self._pending[0][0]:
            self._sensors.freeze_torque(self._pending.pop(0)[1])


def _time(fault: tuple[float, slice]) -> float:
    return fault[0]
