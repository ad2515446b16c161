"""The log of a driver's buses in real time: frames go through a ring to a process of its own, which writes a file."""

from __future__ import annotations

import heapq
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Sequence
from multiprocessing.synchronize import Event
from pathlib import Path

import can

from preshape.hal.can.frame_ring import CAPACITY, FRAME, FrameWriter, frames_of
from preshape.hal.can.tapped_bus import TappedBus
from preshape.hal.tick_ring import RingMemory, RingReader, RingWriter, ring_memory
from preshape.sim_backend.bus_log import BusLog
from preshape.tools.child_process import await_end, start

FINISH_S = 30.0
"""Longest time that it may take to write what is left, s."""
READER = 0
NAP_S = 0.05
"""Time between two looks at an empty ring, s."""
FLUSH_S = 0.5
"""Time after which what has come is in the file, s."""
SORT_S = 0.1
"""How much later than a younger frame an older one may be told of: what waits in a socket has its stamp already."""
MOST_AT_ONCE = 4096
"""Frames taken from the ring at once."""
NICENESS = 5


class BusRecorder:
    """Writes down what passes one end of some buses; a context manager, which ends when all is written.

    The driver never waits. What it tells of faster than it can be written is lost, and an error frame stands in its
    place. When the driver's process is killed, the log is completed.
    """

    def __init__(self, file: Path, buses: Sequence[str]) -> None:
        """Begin a file for buses of these names.

        Raises:
            DeviceUnreachable: the process that writes does not come up.
        """
        context = multiprocessing.get_context("spawn")
        memory, ready = ring_memory(context, CAPACITY, FRAME), context.Event()
        self._numbers = {name: number for number, name in enumerate(buses)}
        self._ring = RingWriter(memory, FRAME)
        self._frames = FrameWriter(self._ring)
        self._process = context.Process(
            name="bus log", target=write_frames, args=(str(file), tuple(buses), memory, ready), daemon=True
        )
        start(self._process, ready)

    def over(self, name: str, bus: can.BusABC, echoes: bool = False) -> can.BusABC:
        """Return an open bus whose frames are written down; `echoes`: it receives what it has sent."""
        number = self._numbers[name]
        return TappedBus(bus, lambda message, received: self._frames.write(number, message, received), echoes)

    def close(self) -> None:
        """Wait until everything is written; may be called twice."""
        self._ring.end()
        await_end(self._process, FINISH_S)

    def __enter__(self) -> BusRecorder:
        return self

    def __exit__(self, *cause: object) -> None:
        self.close()


def write_frames(file: str, buses: Sequence[str], memory: RingMemory, ready: Event) -> None:
    """Be the process that writes: until the ring has ended, or the driver's process."""
    # Ctrl-C is for the driver, which then ends the ring.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICENESS)
    driver = multiprocessing.parent_process()
    log = BusLog(Path(file))
    ready.set()
    try:
        copy_frames(RingReader(memory, READER, FRAME), buses, log, lambda: driver is not None and driver.is_alive())
    finally:
        log.close()


def copy_frames(reader: RingReader, buses: Sequence[str], log: BusLog, goes_on: Callable[[], bool]) -> None:
    """Write what comes through a ring, in the order of its stamps, until the ring has ended or it does not go on."""
    waiting: list[tuple[float, int, can.Message]] = []
    count, lost, newest, flushed_s = 0, 0, 0.0, time.monotonic()
    ends = False
    while not ends:
        last_look = not goes_on()
        records = reader.read(MOST_AT_ONCE)
        if reader.dropped > lost and len(records):
            lost, stamp = reader.dropped, float(records["stamp_ns"][0]) * 1e-9
            log.write(can.Message(timestamp=stamp, channel=buses[0], is_error_frame=True, is_extended_id=False))
        for message in frames_of(records, buses):
            newest = max(newest, message.timestamp)
            heapq.heappush(waiting, (message.timestamp, count, message))
            count += 1
        ends = not len(records) and (reader.ended or last_look)
        while waiting and (ends or waiting[0][0] < newest - SORT_S):
            log.write(heapq.heappop(waiting)[2])
        if time.monotonic() - flushed_s > FLUSH_S:
            log.flush()
            flushed_s = time.monotonic()
        if not len(records) and not ends:
            time.sleep(NAP_S)
