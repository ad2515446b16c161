"""The simulated joint modules as a `Device`: what they accept, when they refuse, and how they stop."""

from __future__ import annotations

import numpy as np

from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState
from preshape.hal.state_monitor import all_finite
from preshape.sim_backend.simulation import Simulation

COMMAND_PERIOD_S = 0.002
WATCHDOG_CYCLES = 5


class MujocoDevice:
    """`preshape.hal.device.Device` of a simulation; whoever owns the clock steps it.

    A module that has taken a first command and then misses `watchdog_cycles` of them goes to FAULT by itself,
    in simulated time. Stopped, faulty or disarmed modules hold the position they measured then.
    """

    def __init__(
        self, simulation: Simulation, period_s: float = COMMAND_PERIOD_S, watchdog_cycles: int = WATCHDOG_CYCLES
    ) -> None:
        """Drive the joints of a simulation with one command every `period_s`."""
        self._simulation = simulation
        self._period_s = period_s
        self._watchdog_ns = round(watchdog_cycles * period_s * 1e9)
        self._status = DeviceStatus.DISARMED
        self._fault = ""
        self._sequence = -1
        self._mode: Mode | None = None
        self._commanded_ns: int | None = None
        self._is_open = False

    def open(self) -> None:
        """Connect; nothing moves. Sequences start anew."""
        if not self._is_open:
            self._is_open = True
            self._sequence = -1
            self._simulation.before_step.append(self._watch)
            self._latch(DeviceStatus.DISARMED, "")

    def read(self, now_ns: int) -> RobotState:
        """Return the newest sample."""
        position, velocity, torque = self._simulation.joint_sensors.read()
        stamp_ns = np.full(LAYOUT.dof, self._simulation.sample_ns, dtype=np.int64)
        return RobotState(self._sequence, position, velocity, torque, stamp_ns, self._status, self._fault)

    def arm(self, now_ns: int) -> None:
        """Hold the measured position and take commands from now on."""
        if not self._is_open:
            raise RuntimeError("arm: the device is not open")
        self._latch(DeviceStatus.ARMED, "")

    def write(self, command: RobotCommand, now_ns: int) -> bool:
        """Take a command if armed, newer than the last and finite."""
        if self._status != DeviceStatus.ARMED or command.sequence <= self._sequence or not is_finite(command):
            return False
        self._sequence = command.sequence
        self._commanded_ns = self._simulation.time_ns
        self._execute(command)
        self._mode = command.mode
        return True

    def stop(self, reason: str, now_ns: int) -> None:
        """Latch STOPPED: hold the measured position."""
        self._latch(DeviceStatus.STOPPED, reason)

    def close(self) -> None:
        """Disconnect; the joints hold their position."""
        if self._is_open:
            self._is_open = False
            self._simulation.before_step.remove(self._watch)
            self._latch(DeviceStatus.DISARMED, "")

    def _execute(self, command: RobotCommand) -> None:
        drives = self._simulation.drives
        match command.mode:
            case Mode.POSITION:
                drives.follow(command.position, command.torque_limit, self._period_s)
            case Mode.TORQUE:
                drives.push(command.torque, command.torque_limit)
            case Mode.HOLD | Mode.BRAKE:
                if self._mode != command.mode:
                    limit = command.torque_limit if command.mode == Mode.HOLD else LAYOUT.torque
                    drives.hold(self._simulation.joint_sensors.read()[0], limit)
            case Mode.DISABLED:
                drives.release()

    def _latch(self, status: DeviceStatus, fault: str) -> None:
        """Change the status and hold the measured position at full strength until the next command."""
        self._status, self._fault = status, fault
        self._mode = self._commanded_ns = None
        self._simulation.drives.hold(self._simulation.joint_sensors.read()[0], LAYOUT.torque)

    def _watch(self, time_ns: int) -> None:
        if self._status == DeviceStatus.ARMED and self._commanded_ns is not None:
            silence_ns = time_ns - self._commanded_ns
            if silence_ns > self._watchdog_ns:
                self._latch(DeviceStatus.FAULT, f"watchdog: no command for {silence_ns / 1e6:.0f} ms")


def is_finite(command: RobotCommand) -> bool:
    """Tell whether every value of a command is a number."""
    return all_finite(command.position) and all_finite(command.torque_limit) and all_finite(command.torque)
