"""The joints of a paced scene, driven from another process by shared memory and requests."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

from preshape.hal.state import Mode, RobotCommand
from preshape.sim_backend.command_cadence import CommandCadence
from preshape.sim_backend.device import MujocoDevice
from preshape.sim_backend.paced_layout import COMMAND, Arm, Close, Open, Stop
from preshape.sim_backend.shared_block import Record, SharedBlock
from preshape.sim_backend.simulation import STEP_NS, Simulation


class SharedJoints:
    """`preshape.sim_backend.paced_physics.Joints` of a `MujocoDevice`."""

    def __init__(
        self,
        simulation: Simulation,
        period_s: float,
        watchdog_cycles: int,
        command_memory: ctypes.Array[ctypes.c_char],
        publish: Callable[[], None],
    ) -> None:
        """Take commands from `command_memory`; `publish` makes visible what a request has done before its answer."""
        self._simulation = simulation
        self._device = MujocoDevice(simulation, period_s, watchdog_cycles)
        self._command = SharedBlock(command_memory, COMMAND)
        self._publish = publish
        self._cadence = CommandCadence(max(1, round(period_s * 1e9 / STEP_NS)))
        self._taken = 0

    def take(self) -> None:
        """Take a new command, if there is one and it is time."""
        version = self._command.version
        if not self._cadence.takes(self._simulation.time_ns // STEP_NS, version != self._taken):
            return
        record = self._command.read()
        if record is None:
            return
        self._taken = version
        command = record[0]
        self._device.write(
            RobotCommand(
                int(command["sequence"]),
                Mode(int(command["mode"])),
                command["position"],
                command["torque_limit"],
                command["torque"],
            ),
            self._simulation.time_ns,
        )

    def fill(self, out: Record) -> None:
        """Write the device's state."""
        state = self._device.read(self._simulation.time_ns)
        out["sequence"], out["status"] = state.sequence, int(state.status)
        out["fault"] = state.fault.encode("ascii", "replace")
        out["position"], out["velocity"], out["torque"] = state.position, state.velocity, state.torque

    def answer(self, request: object) -> str | None:
        """Open, arm, stop or close the device."""
        now_ns = self._simulation.time_ns
        match request:
            case Open():
                self._device.open()
            case Arm():
                return self._arm(now_ns)
            case Stop(reason):
                self._device.stop(reason, now_ns)
                return None
            case Close():
                self._device.close()
            case _:
                raise TypeError(f"request: got {request!r}, allowed are Open, Arm, Stop and Close")
        self._publish()
        return ""

    def close(self) -> None:
        """Close the device; the joints hold their position."""
        self._device.close()

    def _arm(self, now_ns: int) -> str:
        self._taken = self._command.version
        self._cadence.reset()
        cause = ""
        try:
            self._device.arm(now_ns)
        except RuntimeError as refusal:
            cause = str(refusal)
        self._publish()
        return cause
