"""A writer for loops without deadlines: it waits for the readers that must lose nothing, but not for ever."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from preshape.hal.tick_record import TICK, TickRecord
from preshape.hal.tick_ring import READERS, RingMemory, RingWriter

PATIENCE_S = 10.0
"""How long a reader may take nothing from a full ring before it is given up, s."""
_NAP_S = 2e-4


class WaitingRingWriter:
    """An observer for lockstep runs: before it overwrites what a reader has yet to take, it waits for it.

    Only readers named by `keep_for` are waited for. One that takes nothing for `patience_s` (its process has ended,
    or hangs) is given up, stands in `given_up`, and is waited for no more; the run goes on.
    """

    def __init__(self, memory: RingMemory, patience_s: float = PATIENCE_S, dtype: np.dtype[Any] = TICK) -> None:
        """Write into memory made by `ring_memory` for the same record type."""
        self.writer = RingWriter(memory, dtype)
        self._patience_s = patience_s
        self._head = self.writer.ring.head
        self.given_up: list[int] = []

    def keep_for(self, reader: int) -> None:
        """Wait for this reader from now on: before its process has started, so that it misses nothing."""
        self._head["kept_for"][reader] = 1

    def notify(self, record: TickRecord) -> None:
        """Copy one record into the ring as soon as there is room."""
        needed = self.writer.count - self.writer.ring.capacity + 1
        if needed > 0:
            for reader in range(READERS):
                if self._head["kept_for"][reader] and self._head["taken"][reader] < needed:
                    self._wait(reader, needed)
        self.writer.notify(record)

    def end(self) -> None:
        """Say that no record follows."""
        self.writer.end()

    def _wait(self, reader: int, needed: int) -> None:
        taken, since_s = -1, 0.0
        while (now_taken := int(self._head["taken"][reader])) < needed:
            now_s = time.monotonic()
            if now_taken != taken:
                taken, since_s = now_taken, now_s
            elif now_s - since_s > self._patience_s:
                self._head["kept_for"][reader] = 0
                self.given_up.append(reader)
                return
            time.sleep(_NAP_S)
