"""A module's torque sensor that freezes or drifts, as it is seen on the bus: its states with other torques in them."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace

import can
import numpy as np

from preshape.hal.can.state_codec import StateCodec
from preshape.hal.can.topology import Group, Module
from preshape.hal.state import Vector


class TorqueFault:
    """Changes the torques in a module's states; all its other frames, and damaged ones, stay as they are.

    Frozen, every state carries the torques of the first one; drifting, `rate` (N m/s) times the time since the
    first is added to every joint's. Only FD frames hold a whole state: on a classic bus nothing is changed.
    """

    def __init__(self, module: Module, group: Group, rate: float | None, now_ns: Callable[[], int]) -> None:
        """Begin with the next state; a rate of None: frozen."""
        self._codec = StateCodec(module, group)
        self._rate, self._now_ns = rate, now_ns
        self._began_ns = now_ns()
        self._first: Vector | None = None

    def __call__(self, message: can.Message) -> can.Message:
        """Return the frame as it goes on the bus."""
        if message.arbitration_id != self._codec.frame_id:
            return message
        report = self._codec.decode(bytes(message.data))
        if report is None:
            return message
        changed = copy(message)
        changed.data = self._codec.encode(replace(report, torque=self._torque(report.torque)))
        return changed

    def _torque(self, measured: Vector) -> Vector:
        if self._rate is not None:
            return measured + self._rate * (self._now_ns() - self._began_ns) * 1e-9
        if self._first is None:
            self._first = np.array(measured)
        return self._first
