"""What the ring's tests let other processes do: a child imports this file, not the tests."""

from __future__ import annotations

from preshape.hal.tick_record import TickRecord, new_record
from preshape.hal.tick_ring import RingMemory, RingReader, RingWriter


def numbered(number: int) -> TickRecord:
    """Return a record all of whose numbers tell which it is."""
    record = new_record()
    record["tick"] = number
    record["position"] = record["torque"] = number
    return record


def write_until_killed(memory: RingMemory) -> None:
    """Write numbered records without end."""
    writer, number = RingWriter(memory), 0
    while True:
        writer.notify(numbered(number))
        number += 1


def read_until_killed(memory: RingMemory) -> None:
    """Read without end."""
    reader = RingReader(memory, 0)
    while True:
        reader.read()
