"""A device without dynamics: joints follow their commands at limited speed; torque is what a spring would need."""

from __future__ import annotations

import numpy as np

from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState

STIFFNESS = 2.0
"""Torque reported for each rad between target and position, N m/rad."""

START = 0.5 * (LAYOUT.lower + LAYOUT.upper)


class KinematicDevice:
    """Keeps the whole `Device` contract; `advance` moves its time on. Test hooks: `fail`, `frozen`, `refuse_arming`."""

    def __init__(self) -> None:
        self.status = DeviceStatus.DISARMED
        self.position = START.copy()
        self.velocity = np.zeros(LAYOUT.dof)
        self.written: list[RobotCommand] = []
        self.stops: list[str] = []
        self.frozen = False
        self.refuse_arming = ""
        self._fault = ""
        self._sequence = 0
        self._time_ns: int | None = None
        self._stamp_ns = 0
        self._target = START.copy()
        self._limit = np.zeros(LAYOUT.dof)
        self._torque_target: np.ndarray | None = None

    def open(self) -> None:
        """Begin in DISARMED."""
        self.status = DeviceStatus.DISARMED

    def advance(self, now_ns: int) -> None:
        """Let the joints move until now."""
        if self._time_ns is not None:
            dt = (now_ns - self._time_ns) * 1e-9
            reach = np.where(self._limit > 0.0, LAYOUT.velocity * dt, 0.0)
            if self._torque_target is not None:
                move = np.clip(self._torque_target, -self._limit, self._limit) * dt
            else:
                move = np.clip(self._target - self.position, -reach, reach)
            self.velocity = move / dt
            self.position = np.clip(self.position + move, LAYOUT.lower, LAYOUT.upper)
        self._time_ns = now_ns

    def read(self, now_ns: int) -> RobotState:
        """Return the current sample; its stamp stays behind while `frozen`."""
        if not self.frozen:
            self._stamp_ns = now_ns
        torque = STIFFNESS * (self._target - self.position) if self._torque_target is None else self._torque_target
        return RobotState(
            self._sequence, self.position, self.velocity, np.clip(torque, -self._limit, self._limit),
            np.full(LAYOUT.dof, self._stamp_ns), self.status, self._fault,
        )  # fmt: skip

    def arm(self, now_ns: int) -> None:
        """Hold the measured position; `RuntimeError` when told to refuse."""
        if self.refuse_arming:
            raise RuntimeError(self.refuse_arming)
        self.status, self._fault = DeviceStatus.ARMED, ""
        self._hold()

    def write(self, command: RobotCommand, now_ns: int) -> bool:
        """Take a newer command if ARMED."""
        if self.status is not DeviceStatus.ARMED or command.sequence <= self._sequence:
            return False
        self._sequence = command.sequence
        self.written.append(command)
        self._limit = command.torque_limit
        self._torque_target = command.torque if command.mode is Mode.TORQUE else None
        self._target = command.position if command.mode is Mode.POSITION else self.position.copy()
        return True

    def stop(self, reason: str, now_ns: int) -> None:
        """Hold where it is, latched."""
        self.stops.append(reason)
        self.status = DeviceStatus.STOPPED
        self._hold()

    def close(self) -> None:
        """Disarm."""
        self.status = DeviceStatus.DISARMED
        self._hold()

    def fail(self, fault: str) -> None:
        """Fall into FAULT, as hardware does on its own."""
        self.status, self._fault = DeviceStatus.FAULT, fault
        self._hold()

    def _hold(self) -> None:
        self._target, self._limit = self.position.copy(), LAYOUT.torque
        self._torque_target = None
