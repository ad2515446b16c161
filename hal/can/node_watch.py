"""What is known of one module from its frames: that it answers, how it is, and that it is the one it was. No I/O."""

from __future__ import annotations

from enum import Enum

from preshape.hal.can.emergency_codec import Emergency
from preshape.hal.can.heartbeat_codec import Heartbeat
from preshape.hal.can.state_codec import temperature_of
from preshape.hal.can.topology import Module
from preshape.hal.can.vocabulary import FIRMWARE_MAJOR, ModuleError, ModuleState

CONTRADICTIONS = 3
"""So many different answers to one and the same broadcast show that two modules have one node number."""


class Answered(Enum):
    """How a state stands to those before it."""

    NEWER = "newer"
    AGAIN = "again"
    STALE = "stale"


class NodeWatch:
    """Follows one module. Broadcasts are named by their numbers in a `BroadcastLog`.

    `answered` is the newest broadcast it has answered (0: none yet), `heard` the newest that had been sent when that
    answer came: later by what is on its way. `state` and `error` are what it said then, `taken` the sequence of the
    last command it has executed; `key` its present arming key as far as known.
    """

    def __init__(self, module: Module) -> None:
        self.module = module
        self.answered = self.heard = 0
        self.state = ModuleState.DISARMED
        self.error = ModuleError.NONE
        self.taken = -1
        self.emergency: Emergency | None = None
        self._payload: bytes | bytearray = b""
        self._contradictions = 0
        self._beat: Heartbeat | None = None
        self._boots = -1
        self._serials: set[int] = set()
        self._firmware_major: int | None = None

    def answer(self, number: int, payload: bytes | bytearray, newest: int) -> Answered:
        """Take note that a broadcast was answered, and which is the newest that has been sent.

        A broadcast that was answered otherwise before is a contradiction.
        """
        if number > self.answered:
            self.answered, self.heard, self._payload = number, newest, payload
            return Answered.NEWER
        if number < self.answered:
            return Answered.STALE
        self._contradictions += payload != self._payload
        return Answered.AGAIN

    @property
    def temperature_degc(self) -> int | None:
        """What the module's newest state says of its temperature; None before the first."""
        return temperature_of(self._payload) if self._payload else None

    def heartbeat(self, beat: Heartbeat) -> None:
        """Take note of who it says it is."""
        self._beat = beat
        self._firmware_major = beat.firmware_major
        self._serials.add(beat.serial)
        if self._boots < 0:
            self._boots = beat.boots

    def firmware(self, version: int) -> None:
        """Take note of the firmware's version as a parameter: major in bits 16 and up."""
        self._firmware_major = version >> 16

    def rearm(self) -> None:
        """Begin anew for an arming: forget an emergency and a start that came before it."""
        self.emergency = None
        self._boots = -1 if self._beat is None else self._beat.boots

    def identity_fault(self) -> str:
        """Return what speaks against driving this module at all, or an empty text."""
        if len(self._serials) > 1 or self._contradictions >= CONTRADICTIONS:
            found = " and ".join(f"{serial:#x}" for serial in sorted(self._serials))
            return f"{self} is there twice (serial numbers {found}): give one of them another node number"
        if self._firmware_major is not None and self._firmware_major != FIRMWARE_MAJOR:
            return f"{self} has firmware {self._firmware_major}, allowed is {FIRMWARE_MAJOR}"
        return ""

    def life_fault(self, newest: int, lost_cycles: int) -> str:
        """Return whether a module that has answered before answers no more, or an empty text."""
        silent = newest - self.heard
        return f"{self} is lost: nothing heard of it for {silent} broadcasts" if silent > lost_cycles else ""

    def armed_fault(self, since: int) -> str:
        """Return why a module armed by broadcast number `since` is not armed any more, or an empty text."""
        if self._beat is not None and self._beat.boots != self._boots and self._boots >= 0:
            return f"{self} has started anew"
        if self.emergency is not None:
            return f"{self} reports {self.emergency.error.name.lower()}"
        if self.answered <= since or self.state is ModuleState.ARMED:
            return ""
        if self.state is ModuleState.DISARMED:
            return f"{self} is disarmed: it has started anew"
        return f"{self} is {self.state.name}, error {self.error.name.lower()}"

    def __str__(self) -> str:
        return f"module {self.module.name} (node {self.module.node})"
