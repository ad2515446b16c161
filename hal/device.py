"""The one contract between the loop and anything with joints: CAN modules, MuJoCo, a remote, a recording."""

from __future__ import annotations

from typing import Protocol

from preshape.hal.state import RobotCommand, RobotState


class DeviceUnreachable(Exception):
    """The device cannot be opened or reached; the message says in one line what to do."""


class Device(Protocol):
    """Joints that report and take commands.

    Life: `open` -> DISARMED (reads work, every write is refused) -> `arm` -> ARMED -> `stop` or a fault
    -> STOPPED / FAULT, latched until `arm` is called again. Before the first command after `arm` the
    joints hold the position measured at that moment. `close` leaves nothing queued and nothing moving.
    """

    def open(self) -> None:
        """Connect; nothing moves. Raises `DeviceUnreachable`."""
        ...

    def read(self, now_ns: int) -> RobotState:
        """Return the newest sample of every joint; never blocks, never raises on a lost sample."""
        ...

    def arm(self, now_ns: int) -> None:
        """Leave DISARMED, STOPPED or FAULT; hold the measured position. `RuntimeError` with the cause if refused."""
        ...

    def write(self, command: RobotCommand, now_ns: int) -> bool:
        """Take a command if ARMED and its sequence is newer than the last; return whether it was taken."""
        ...

    def stop(self, reason: str, now_ns: int) -> None:
        """Latch STOPPED: damped hold at the measured position, whatever the state."""
        ...

    def close(self) -> None:
        """Disconnect; may be called twice."""
        ...
