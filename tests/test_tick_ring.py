"""Laws of the ring that carries tick records to other processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ring_processes import numbered, read_until_killed, write_until_killed

from preshape.hal.tick_record import TICK, TickRecord
from preshape.hal.tick_ring import READERS, Ring, RingMemory, RingReader, RingWriter, ring_memory
from preshape.hal.waiting_ring import WaitingRingWriter

SPAWN = multiprocessing.get_context("spawn")
SHARED_MEMORY = Path("/dev/shm")


def whole(records: TickRecord) -> bool:
    return bool((records["position"] == records["tick"][:, None]).all()) and bool(
        (records["torque"] == records["tick"][:, None]).all()
    )


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(1, 12)), max_size=30))
@settings(max_examples=60, deadline=None)
def test_what_is_read_is_in_order_and_what_is_not_is_counted(turns: list[tuple[int, int]]) -> None:
    memory = ring_memory(SPAWN, 8)
    writer, reader = RingWriter(memory), RingReader(memory, 3)
    written, seen = 0, []
    for writes, most in turns:
        for _ in range(writes):
            writer.notify(numbered(written))
            written += 1
        seen += reader.read(most)["tick"].tolist()
        assert seen == sorted(set(seen))
        assert len(seen) + reader.dropped + min(reader.pending, written) == written
    seen += reader.read(100)["tick"].tolist()
    assert reader.pending == 0
    assert len(seen) + reader.dropped == written
    assert writer.dropped(3) == reader.dropped


def test_readers_do_not_take_from_one_another() -> None:
    memory = ring_memory(SPAWN, 16)
    writer, readers = RingWriter(memory), [RingReader(memory, number) for number in range(READERS)]
    for number in range(10):
        writer.notify(numbered(number))
    assert all(reader.read()["tick"].tolist() == list(range(10)) for reader in readers)


def test_a_reader_that_takes_the_place_of_another_goes_on_where_it_ended() -> None:
    memory = ring_memory(SPAWN, 16)
    writer = RingWriter(memory)
    for number in range(6):
        writer.notify(numbered(number))
    RingReader(memory, 0).read(4)
    assert RingReader(memory, 0).read()["tick"].tolist() == [4, 5]


def test_newest_leaves_out_what_came_before() -> None:
    memory = ring_memory(SPAWN, 4)
    writer, reader = RingWriter(memory), RingReader(memory, 0)
    assert reader.newest() is None
    for number in range(9):
        writer.notify(numbered(number))
    newest = reader.newest()
    assert newest is not None and newest["tick"] == 8
    assert len(reader.read()) == 0 and reader.dropped == 0


def test_a_record_that_is_being_overwritten_is_dropped_not_torn() -> None:
    memory = ring_memory(SPAWN, 4)
    writer, reader = RingWriter(memory), RingReader(memory, 0)
    for number in range(4):
        writer.notify(numbered(number))
    # The writer is in the middle of record 4, which lies where record 0 was.
    Ring(memory).begun[...] = 5
    assert reader.read()["tick"].tolist() == [1, 2, 3]
    assert reader.dropped == 1


def test_records_read_beside_a_writer_at_full_speed_are_whole() -> None:
    memory = ring_memory(SPAWN, 8)
    writer, reader = RingWriter(memory), RingReader(memory, 0)
    records = [numbered(number) for number in range(4000)]

    def write() -> None:
        for record in records:
            writer.notify(record)
        writer.end()

    thread = threading.Thread(target=write)
    thread.start()
    seen = 0
    while not reader.ended:
        batch = reader.read()
        assert whole(batch)
        seen += len(batch)
    thread.join()
    assert seen + reader.dropped == len(records)


def _in_child(work: Callable[[RingMemory], None], memory: RingMemory, until: Callable[[], bool]) -> None:
    """Run something in a process of its own and kill it in the middle of its work."""
    child = SPAWN.Process(target=work, args=(memory,), daemon=True)
    child.start()
    deadline = time.monotonic() + 30.0
    while not until():
        assert time.monotonic() < deadline
        time.sleep(0.005)
    assert child.pid is not None
    os.kill(child.pid, signal.SIGKILL)
    child.join()


def test_a_killed_writer_leaves_whole_records() -> None:
    memory = ring_memory(SPAWN, 64)
    reader = RingReader(memory, 0)
    _in_child(write_until_killed, memory, lambda: reader.pending > 200)
    records = reader.read()
    assert len(records) >= 63 and whole(records)
    assert np.array_equal(np.diff(records["tick"]), np.ones(len(records) - 1))


def test_a_killed_reader_does_not_disturb_the_writer() -> None:
    memory = ring_memory(SPAWN, 64)
    writer, head = RingWriter(memory), Ring(memory).head

    def write_and_look() -> bool:
        writer.notify(numbered(writer.count))
        return bool(head["taken"][0] > 0)

    _in_child(read_until_killed, memory, write_and_look)
    before = writer.count
    for number in range(200):
        writer.notify(numbered(number))
    assert writer.count == before + 200


def test_nothing_is_left_in_shared_memory() -> None:
    before = set(SHARED_MEMORY.iterdir())
    memory = ring_memory(SPAWN, 64)
    assert set(SHARED_MEMORY.iterdir()) == before
    assert len(memory) > 64 * TICK.itemsize


def test_a_waiting_writer_loses_nothing_however_slow_the_reader() -> None:
    memory = ring_memory(SPAWN, 4)
    writer, reader = WaitingRingWriter(memory), RingReader(memory, 2)
    writer.keep_for(2)
    thread = threading.Thread(target=lambda: [writer.notify(numbered(number)) for number in range(100)])
    thread.start()
    seen: list[int] = []
    while len(seen) < 100:
        seen += reader.read(3)["tick"].tolist()
        time.sleep(0.001)
    thread.join()
    assert seen == list(range(100)) and reader.dropped == 0 and not writer.given_up


def test_a_waiting_writer_gives_a_reader_up_that_takes_nothing() -> None:
    memory = ring_memory(SPAWN, 4)
    writer = WaitingRingWriter(memory, patience_s=0.05)
    writer.keep_for(1)
    started = time.monotonic()
    for number in range(100):
        writer.notify(numbered(number))
    assert 0.05 <= time.monotonic() - started < 5.0
    assert writer.given_up == [1] and writer.writer.count == 100


def test_a_waiting_writer_waits_for_nobody_who_is_not_named() -> None:
    memory = ring_memory(SPAWN, 4)
    writer, reader = WaitingRingWriter(memory), RingReader(memory, 0)
    for number in range(10):
        writer.notify(numbered(number))
    assert reader.read()["tick"].tolist() == [6, 7, 8, 9] and reader.dropped == 6


def test_a_place_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match="reader: got 8, allowed is 0 .. 7"):
        RingReader(ring_memory(SPAWN, 4), READERS)
    with pytest.raises(ValueError, match="capacity: got 1"):
        ring_memory(SPAWN, 1)
