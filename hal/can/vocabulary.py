"""The words of the protocol: modes, states, errors, parameters and answers, by their numbers on the wire."""

from __future__ import annotations

from enum import IntEnum

from preshape.hal.state import DeviceStatus, Mode

FIRMWARE_MAJOR = 1
"""Modules whose firmware has another major version are not driven."""

WHOLE_MODULE = 0xFF
"""In place of a joint's number: the whole module."""


class WireMode(IntEnum):
    """What a command broadcast asks for: `preshape.hal.state.Mode`, or only the module states."""

    DISABLED = Mode.DISABLED
    HOLD = Mode.HOLD
    POSITION = Mode.POSITION
    TORQUE = Mode.TORQUE
    BRAKE = Mode.BRAKE
    POLL = 7
    """No command: report, and go on with what you do."""


class ModuleState(IntEnum):
    """Where a module is in its life, with the numbers of `DeviceStatus`; only ARMED modules take commands."""

    DISARMED = DeviceStatus.DISARMED
    ARMED = DeviceStatus.ARMED
    STOPPED = DeviceStatus.STOPPED
    FAULT = DeviceStatus.FAULT


class ModuleError(IntEnum):
    """Why a module is not well; the first that came stays until it is armed again."""

    NONE = 0
    WATCHDOG = 1
    """An armed module got no command for too many cycles; it holds, damped."""
    OVER_TEMPERATURE = 2
    OVER_TORQUE = 3
    SENSOR = 4
    DRIVE = 5


class Parameter(IntEnum):
    """What can be asked of a module, and in part be set."""

    FIRMWARE = 0
    SERIAL = 1
    ACTUATORS = 2
    KEY = 3
    """Changes at every start and whenever the module leaves ARMED; arming must name it."""
    SESSION = 4
    """Writing it arms: from then on commands of this session are taken, and no others."""
    CYCLE_US = 5
    WATCHDOG_CYCLES = 6
    LOWER_LIMIT = 8
    UPPER_LIMIT = 9
    TORQUE_LIMIT = 10
    STIFFNESS = 11
    DAMPING = 12
    TORQUE_OFFSET = 13


REAL_PARAMETERS = frozenset(
    {
        Parameter.LOWER_LIMIT,
        Parameter.UPPER_LIMIT,
        Parameter.TORQUE_LIMIT,
        Parameter.STIFFNESS,
        Parameter.DAMPING,
        Parameter.TORQUE_OFFSET,
    }
)
"""Parameters of one joint each, real numbers in SI units; all others are whole numbers of the module."""

READ_ONLY_PARAMETERS = frozenset({Parameter.FIRMWARE, Parameter.SERIAL, Parameter.ACTUATORS, Parameter.KEY})

PARAMETER_UNITS = {
    Parameter.CYCLE_US: "us",
    Parameter.LOWER_LIMIT: "rad",
    Parameter.UPPER_LIMIT: "rad",
    Parameter.TORQUE_LIMIT: "N m",
    Parameter.STIFFNESS: "N m/rad",
    Parameter.DAMPING: "N m s/rad",
    Parameter.TORQUE_OFFSET: "N m",
}


class Operation(IntEnum):
    """What is to be done with a parameter."""

    READ = 0
    WRITE = 1


class Answer(IntEnum):
    """How a parameter request ended."""

    DONE = 0
    UNKNOWN_PARAMETER = 1
    UNKNOWN_JOINT = 2
    READ_ONLY = 3
    OUT_OF_RANGE = 4
    WRONG_KEY = 5
    """Arming with a key that is not the module's present one: the order is from before a stop."""
    NOT_NOW = 6
    """The module's state does not allow it."""
