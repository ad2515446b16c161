"""A device that another process of this machine serves over Zenoh."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from preshape.hal.device import DeviceUnreachable
from preshape.hal.layout import LAYOUT
from preshape.hal.remote_line import ANSWER_S, RemoteLine
from preshape.hal.remote_wire import Record, decode_state, encode_command, state_of
from preshape.hal.state import DeviceStatus, RobotCommand, RobotState

CLOCKS_NS = 50_000_000
"""How far apart the two processes' clocks may seem, beyond the time that the answer took, ns."""

_NOTHING = np.full(LAYOUT.dof, np.nan)


class RemoteDevice:
    """`preshape.hal.device.Device` behind a `RemoteLine`.

    `read` returns the newest state that has arrived, stamped by the served device itself, so that a state that was
    held up is as old as it is. A server that has vanished is a FAULT at once, one that has been stopped shows by the
    age of its states; the safety gate judges both. `write` sends and does not wait: `RobotState.sequence` tells what
    has arrived. Commands are numbered per arming, so none from before a stop is taken after it. `world` describes
    what is served besides the joints, from `open` on.
    """

    def __init__(self, line: RemoteLine) -> None:
        """Take the line; nothing is asked before `open`."""
        self._line = line
        self._state: RobotState | None = None
        self._seen: bytes | None = None
        self._open = self._armed = False
        self._epoch = -1
        self._sequence = -1
        self.world: dict[str, Any] | None = None

    @property
    def lost(self) -> int:
        """How many states were sent between the first and the newest that came, and have not come."""
        newest = decode_state(self._line.newest("state") or b"")
        first = decode_state(self._line.first.get("state", b""))
        if first is None or newest is None:
            return 0
        return max(0, int(newest["seq"]) - int(first["seq"]) + 1 - self._line.received["state"])

    def open(self) -> None:
        """Become the one client whose commands are taken. `DeviceUnreachable` if there is another, or no server."""
        asked_ns = time.monotonic_ns()
        try:
            reply = self._line.ask("open")
        except RuntimeError as refusal:
            raise DeviceUnreachable(f"open: {refusal}") from refusal
        took_ns = time.monotonic_ns() - asked_ns
        apart_ns = abs(reply.now_ns - asked_ns)
        if apart_ns > took_ns + CLOCKS_NS:
            apart = f"{apart_ns * 1e-9:.3f} s apart"
            raise DeviceUnreachable(f"open: clocks are {apart}: a device can be served on the same machine only")
        self._open, self._armed = True, False
        self._sequence, self.world = -1, reply.world
        self._await_state(reply.epoch)

    def read(self, now_ns: int) -> RobotState:
        """Return the newest state that has arrived; before the first one, nothing but a fault."""
        self._take_newest()
        state = self._state
        if state is None:
            stamps = np.zeros(LAYOUT.dof, np.int64)
            return RobotState(-1, _NOTHING, _NOTHING, _NOTHING, stamps, DeviceStatus.FAULT, "no state has arrived")
        if self._line.gone.is_set():
            return _with_fault(state, "the process that serves the device has gone")
        return state

    def arm(self, now_ns: int) -> None:
        """Hold the measured position and take commands from now on."""
        reply = self._line.ask("arm")
        self._await_state(reply.epoch)
        self._epoch, self._armed = reply.epoch, True

    def write(self, command: RobotCommand, now_ns: int) -> bool:
        """Send a command if armed, newer than the last and finite; the server takes it unless it comes too late."""
        if not (self._open and self._armed) or command.sequence <= self._sequence or not _is_finite(command):
            return False
        self._take_newest()
        if self._line.gone.is_set() or self._state is None or self._state.status is not DeviceStatus.ARMED:
            self._armed = False
            return False
        self._sequence = command.sequence
        self._line.send_command(encode_command(command, self._line.client, self._epoch, time.monotonic_ns()))
        return True

    def stop(self, reason: str, now_ns: int) -> None:
        """Latch STOPPED; the server takes it before any command, and does so by itself when this process ends."""
        self._armed = False
        self._line.tell("stop", reason)

    def close(self) -> None:
        """Disconnect; the joints hold their position. Harmless when the server has gone."""
        self._armed = False
        if not self._open:
            return
        self._open = False
        try:
            self._line.ask("close")
        except (DeviceUnreachable, RuntimeError):
            # Gone, or taken over: there is nothing left to be closed.
            return

    def _take_newest(self) -> Record | None:
        payload = self._line.newest("state")
        if payload is None or payload is self._seen:
            return None
        record = decode_state(payload)
        if record is None:
            return None
        self._seen = payload
        self._state = state_of(record)
        return record

    def _await_state(self, epoch: int) -> None:
        """Wait for a state of an epoch: what `read` returns next is not from before it."""
        deadline = time.monotonic() + ANSWER_S
        while time.monotonic() < deadline and not self._line.gone.is_set():
            record = self._take_newest()
            if record is not None and int(record["epoch"]) >= epoch:
                return
            time.sleep(0.0005)
        raise DeviceUnreachable("the served device answers, but sends no states")


def _with_fault(state: RobotState, fault: str) -> RobotState:
    return RobotState(
        state.sequence, state.position, state.velocity, state.torque, state.stamp_ns, DeviceStatus.FAULT, fault
    )


def _is_finite(command: RobotCommand) -> bool:
    values = command.position, command.torque_limit, command.torque
    return all(bool(np.isfinite(value).all()) for value in values)
