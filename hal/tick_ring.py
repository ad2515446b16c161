"""Tick records on their way to other processes: a ring in shared memory, one writer, several readers.

The writer never waits; a reader that is slower than it loses the oldest records and counts them. The memory has no
name in the file system and is gone with the last process that holds it, however that ends.
"""

from __future__ import annotations

import ctypes
from multiprocessing.context import SpawnContext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from preshape.hal.tick_record import TICK, TickRecord

READERS = 8
"""Places for readers; each has a number of its own, 0 .. READERS - 1."""

CAPACITY = 4096
"""Records kept by default: 8 s at 500 Hz."""

HEAD = np.dtype(
    [
        ("begun", np.int64),
        ("written", np.int64),
        ("ended", np.int64),
        ("taken", np.int64, (READERS,)),
        ("dropped", np.int64, (READERS,)),
        ("kept_for", np.int64, (READERS,)),
    ]
)
"""Records begun and written so far, whether the writer has ended; of each reader how many records it has taken or
skipped, how many of them it has lost, and whether a writer that may wait should wait for it."""

RingMemory = ctypes.Array[ctypes.c_char]


def ring_memory(context: SpawnContext, capacity: int = CAPACITY, dtype: np.dtype[Any] = TICK) -> RingMemory:
    """Return zeroed memory for a ring of so many records, to be handed to child processes."""
    if capacity < 2:
        raise ValueError(f"capacity: got {capacity}, allowed is >= 2")
    return context.RawArray("c", HEAD.itemsize + capacity * dtype.itemsize)


class Ring:
    """The view of a ring's memory that writer and readers share: `head` and the slots (capacity,).

    Record k, counted from 0, lies in slot k % capacity; it is whole while `written` > k, and untouched while
    `begun` <= k + capacity.
    """

    def __init__(self, memory: RingMemory, dtype: np.dtype[Any] = TICK) -> None:
        """Look at memory made by `ring_memory` for the same record type."""
        self.capacity = (len(memory) - HEAD.itemsize) // dtype.itemsize
        self.head: NDArray[np.void] = np.frombuffer(memoryview(memory), HEAD, 1)[0:1].reshape(())
        self.slots: NDArray[np.void] = np.frombuffer(memoryview(memory), dtype, self.capacity, HEAD.itemsize)
        self.begun: NDArray[np.int64] = self.head["begun"][...]
        self.written: NDArray[np.int64] = self.head["written"][...]


class RingWriter:
    """The one writer; an observer of the loop. About a microsecond a record."""

    def __init__(self, memory: RingMemory, dtype: np.dtype[Any] = TICK) -> None:
        """Write into memory made by `ring_memory` for the same record type."""
        self.ring = Ring(memory, dtype)
        self._count = int(self.ring.written)

    @property
    def count(self) -> int:
        """How many records have been written."""
        return self._count

    def dropped(self, reader: int) -> int:
        """Return how many records a reader has lost so far, as it says itself."""
        return int(self.ring.head["dropped"][reader])

    def notify(self, record: TickRecord) -> None:
        """Copy one record into the ring, over the oldest one; never waits."""
        ring, count = self.ring, self._count
        ring.begun[...] = count + 1
        ring.slots[count % ring.capacity] = record
        ring.written[...] = self._count = count + 1

    def end(self) -> None:
        """Say that no record follows."""
        self.ring.head["ended"] = 1


class RingReader:
    """One reader, which takes records in the order they were written.

    `dropped` counts those that were overwritten before they were taken.
    """

    def __init__(self, memory: RingMemory, reader: int, dtype: np.dtype[Any] = TICK) -> None:
        """Take the place of this number, and go on where whoever had it before has ended."""
        if not 0 <= reader < READERS:
            raise ValueError(f"reader: got {reader}, allowed is 0 .. {READERS - 1}")
        self.ring = Ring(memory, dtype)
        self._taken: NDArray[np.int64] = self.ring.head["taken"][reader : reader + 1]
        self._dropped: NDArray[np.int64] = self.ring.head["dropped"][reader : reader + 1]

    @property
    def dropped(self) -> int:
        """How many records have been lost."""
        return int(self._dropped[0])

    @property
    def pending(self) -> int:
        """How many records are written and not yet taken; more than the capacity when some are lost already."""
        return int(self.ring.written) - int(self._taken[0])

    @property
    def ended(self) -> bool:
        """Whether the writer has ended and everything is taken."""
        return bool(self.ring.head["ended"]) and self.pending == 0

    def read(self, most: int = 256) -> TickRecord:
        """Return the next records (n,), oldest first, n <= most; none when nothing new is there. Never waits."""
        ring = self.ring
        written, taken = int(ring.written), int(self._taken[0])
        first = max(taken, written - ring.capacity)
        last = min(first + most, written)
        records = ring.slots[np.arange(first, last) % ring.capacity]
        # What the writer has reached meanwhile may be torn.
        whole = min(max(first, int(ring.begun) - ring.capacity), last)
        self._dropped[0] += whole - taken
        self._taken[0] = last
        return records[whole - first :]

    def newest(self) -> TickRecord | None:
        """Return the newest record and leave out all before it, without counting them; None before the first."""
        written = int(self.ring.written)
        if not written:
            return None
        record = self.ring.slots[(written - 1) % self.ring.capacity, ...].copy()
        self._taken[0] = written
        return record if int(self.ring.begun) <= written - 1 + self.ring.capacity else None
