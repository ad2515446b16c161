"""Which broadcasts were sent when: tells an answer's age, and a wrong or stale sequence from a right one."""

from __future__ import annotations

from preshape.hal.can.command_codec import SEQUENCES

KEPT = 1024
"""Broadcasts that are remembered; an answer to an older one is no answer."""


class BroadcastLog:
    """Numbers broadcasts 1, 2, 3, ... (`newest`), with their sequences on the wire, times and commands."""

    def __init__(self, first_sequence: int) -> None:
        """Begin with a sequence on the wire."""
        self.newest = 0
        self._first = first_sequence
        self._sent_ns = [0] * KEPT
        self._command = [0] * KEPT

    def add(self, now_ns: int, command_sequence: int) -> int:
        """Note a broadcast that carries a command's sequence (-1: none); return its sequence on the wire."""
        self.newest += 1
        self._sent_ns[self.newest % KEPT] = now_ns
        self._command[self.newest % KEPT] = command_sequence
        return (self._first + self.newest) % SEQUENCES

    def find(self, sequence: int) -> int:
        """Return the number of the broadcast with a sequence on the wire, 0 if it is not among those kept."""
        back = (self._first + self.newest - sequence) % SEQUENCES
        return self.newest - back if back < min(KEPT, self.newest) else 0

    def sent_ns(self, number: int) -> int:
        """Return when a kept broadcast was sent."""
        return self._sent_ns[number % KEPT]

    def command(self, number: int) -> int:
        """Return the sequence of the command that a kept broadcast carried, -1 for none."""
        return self._command[number % KEPT]
