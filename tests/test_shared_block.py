"""A reader of a shared block sees whole records only."""

from __future__ import annotations

import multiprocessing
import threading

import numpy as np

from preshape.sim_backend.shared_block import SharedBlock, shared_bytes

DTYPE = np.dtype([("number", np.int64), ("values", np.float64, (200,))])


def blocks() -> tuple[SharedBlock, SharedBlock]:
    memory = shared_bytes(multiprocessing.get_context("spawn"), DTYPE)
    return SharedBlock(memory, DTYPE), SharedBlock(memory, DTYPE)


def test_what_is_published_is_read_and_nothing_before() -> None:
    writer, reader = blocks()
    writer.record[0]["number"] = 7
    first = reader.read()
    assert first is not None and first[0]["number"] == 0 and reader.version == 0
    writer.publish()
    second = reader.read()
    assert second is not None and second[0]["number"] == 7 and reader.version == 1


def test_a_record_read_while_another_is_written_is_whole() -> None:
    writer, reader = blocks()
    done = threading.Event()

    def write() -> None:
        for number in range(1, 3000):
            writer.record[0]["number"] = number
            writer.record[0]["values"] = number
            writer.publish()
        done.set()

    thread = threading.Thread(target=write)
    thread.start()
    seen = 0
    while not done.is_set():
        record = reader.read()
        if record is not None:
            assert (record[0]["values"] == record[0]["number"]).all()
            assert record[0]["number"] >= seen
            seen = int(record[0]["number"])
    thread.join()


def test_a_writer_stuck_in_the_middle_makes_reading_give_up() -> None:
    writer, reader = blocks()
    writer._counter[0] += 1
    assert reader.read() is None
