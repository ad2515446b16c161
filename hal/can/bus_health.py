"""What error frames say about a bus: its condition, and how often what went wrong. Pure."""

from __future__ import annotations

from collections import Counter
from enum import IntEnum

from preshape.hal.can.checksum import Bytes

CONTROLLER, BUS_OFF, RESTARTED = 0x004, 0x040, 0x100
"""Classes of SocketCAN's error frames that change the condition, as bits of their identifier."""

_CLASSES = {
    0x001: "transmit timeout",
    0x002: "arbitration lost",
    CONTROLLER: "controller",
    0x008: "protocol",
    0x010: "transceiver",
    0x020: "no acknowledgement",
    BUS_OFF: "bus off",
    0x080: "bus error",
    RESTARTED: "restarted",
}
_OVERFLOW, _WARNING, _PASSIVE, _ACTIVE = 0x03, 0x0C, 0x30, 0x40


class BusCondition(IntEnum):
    """How well a bus controller is, by its error counters; an OFF one neither sends nor receives."""

    ACTIVE = 0
    WARNING = 1
    PASSIVE = 2
    OFF = 3


class BusHealth:
    """Follows one bus through its error frames.

    `condition` is the present one; `was_off` stays until `forget`, for a bus that was off has lost frames however
    soon it recovered; `counts` says how often each class came, receive and transmit overflows by themselves.
    """

    def __init__(self) -> None:
        self.condition = BusCondition.ACTIVE
        self.was_off = False
        self.counts: Counter[str] = Counter()

    def take(self, error_class: int, content: Bytes) -> None:
        """Take one error frame: its identifier's class bits and its content."""
        for bit, name in _CLASSES.items():
            if error_class & bit:
                self.counts[name] += 1
        if error_class & RESTARTED:
            self.condition = BusCondition.ACTIVE
        if error_class & CONTROLLER and len(content) > 1:
            self._controller(content[1])
        if error_class & BUS_OFF:
            self.condition = BusCondition.OFF
            self.was_off = True

    def forget(self) -> None:
        """Forget that the bus has been off; its present condition and the counts stay."""
        self.was_off = self.condition is BusCondition.OFF

    def _controller(self, flags: int) -> None:
        self.counts["overflow"] += bool(flags & _OVERFLOW)
        if flags & _PASSIVE:
            self.condition = BusCondition.PASSIVE
        elif flags & _WARNING:
            self.condition = BusCondition.WARNING
        elif flags & _ACTIVE:
            self.condition = BusCondition.ACTIVE
