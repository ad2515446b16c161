"""The slow parameters of one simulated joint module: what can be read, what can be set, and within which range."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from preshape.hal.can.topology import Module
from preshape.hal.can.vocabulary import FIRMWARE_MAJOR, REAL_PARAMETERS, Answer, Parameter
from preshape.hal.layout import LAYOUT
from preshape.hal.state import Vector
from preshape.sim_backend.drives import JointDrives, Joints

FIRMWARE_MINOR = 0
FIRMWARE_VERSION = FIRMWARE_MAJOR << 16 | FIRMWARE_MINOR << 8
SERIAL_BASE = 0x5A480000

TRAVEL_RESERVE = 0.02
"""A module takes targets so far beyond the joint's limits: end stops give way by less, rad."""
_WHOLE_RANGES = {Parameter.CYCLE_US: (200, 100_000), Parameter.WATCHDOG_CYCLES: (1, 10_000)}


@dataclass(slots=True)
class ModuleParameters:
    """One module's parameters; arrays are (n,), in the order of its joints, SI units."""

    module: Module
    drives: JointDrives
    joints: Joints
    cycle_us: int = 2000
    watchdog_cycles: int = 5
    serial: int = 0
    lower: Vector = field(init=False)
    upper: Vector = field(init=False)
    torque_limit: Vector = field(init=False)
    torque_offset: Vector = field(init=False)

    def __post_init__(self) -> None:
        self.serial = self.serial or SERIAL_BASE + self.module.node
        self.lower = LAYOUT.lower[self.joints] - TRAVEL_RESERVE
        self.upper = LAYOUT.upper[self.joints] + TRAVEL_RESERVE
        self.torque_limit = LAYOUT.torque[self.joints].copy()
        self.torque_offset = np.zeros(len(self.module.joints))

    @property
    def watchdog_ns(self) -> int:
        """How long an armed module goes on without a command."""
        return self.cycle_us * self.watchdog_cycles * 1000

    def whole(self, parameter: Parameter) -> int:
        """Return a parameter of the whole module that does not change with its state."""
        match parameter:
            case Parameter.FIRMWARE:
                return FIRMWARE_VERSION
            case Parameter.SERIAL:
                return self.serial
            case Parameter.ACTUATORS:
                return len(self.module.joints)
            case Parameter.CYCLE_US:
                return self.cycle_us
            case Parameter.WATCHDOG_CYCLES:
                return self.watchdog_cycles
            case _:
                raise ValueError(f"parameter: got {parameter.name}, allowed are the module's constant whole numbers")

    def set_whole(self, parameter: Parameter, value: int) -> Answer:
        """Set a parameter of the whole module."""
        least, most = _WHOLE_RANGES[parameter]
        if not least <= value <= most:
            return Answer.OUT_OF_RANGE
        if parameter is Parameter.CYCLE_US:
            self.cycle_us = value
        else:
            self.watchdog_cycles = value
        return Answer.DONE

    def real(self, parameter: Parameter, joint: int) -> float:
        """Return a parameter of one of the module's joints."""
        return float(self._array(parameter)[joint])

    def set_real(self, parameter: Parameter, joint: int, value: float) -> Answer:
        """Set a parameter of one of the module's joints; limits may be narrowed, never widened."""
        if parameter not in REAL_PARAMETERS or not math.isfinite(value):
            return Answer.OUT_OF_RANGE
        index = self.module.indices[joint]
        least, most = {
            Parameter.LOWER_LIMIT: (LAYOUT.lower[index] - TRAVEL_RESERVE, self.upper[joint]),
            Parameter.UPPER_LIMIT: (self.lower[joint], LAYOUT.upper[index] + TRAVEL_RESERVE),
            Parameter.TORQUE_LIMIT: (0.0, LAYOUT.torque[index]),
            Parameter.STIFFNESS: (1e-3, 1e5),
            Parameter.DAMPING: (0.0, 1e4),
            Parameter.TORQUE_OFFSET: (-LAYOUT.torque[index], LAYOUT.torque[index]),
        }[parameter]
        if not least <= value <= most:
            return Answer.OUT_OF_RANGE
        values = self._array(parameter)
        values[joint] = value
        if parameter is Parameter.STIFFNESS:
            self.drives.scale_gains(values, self._array(Parameter.DAMPING), self.joints)
        elif parameter is Parameter.DAMPING:
            self.drives.scale_gains(self._array(Parameter.STIFFNESS), values, self.joints)
        return Answer.DONE

    def _array(self, parameter: Parameter) -> Vector:
        """Return the joints' values: the module's own array, or a copy of the drives' gains."""
        match parameter:
            case Parameter.LOWER_LIMIT:
                return self.lower
            case Parameter.UPPER_LIMIT:
                return self.upper
            case Parameter.TORQUE_LIMIT:
                return self.torque_limit
            case Parameter.TORQUE_OFFSET:
                return self.torque_offset
            case _:
                stiffness, damping = self.drives.gains(self.joints)
                return stiffness if parameter is Parameter.STIFFNESS else damping
