"""The process that writes a run's recording: from two rings in shared memory to two files."""

from __future__ import annotations

import multiprocessing
import os
import signal
import struct
import threading
import time
from dataclasses import dataclass
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import TYPE_CHECKING

from preshape.hal.byte_ring import PIECE, ByteReader
from preshape.hal.recording_file import RecordingFile
from preshape.hal.tick_ring import RingMemory, RingReader
from preshape.tools.answer_pack import unpack
from preshape.tools.part_figures import PartsMemory, PartsReader

if TYPE_CHECKING:
    from preshape.tools.rerun_content import RerunContent

READER = 0
"""The recorder's place at its rings: they are its own."""
NAP_S = 0.05
"""Time between two looks at an empty ring, s."""
FLUSH_S = 0.5
"""Time after which what has come is completed in the files, s."""
NICENESS = 5


@dataclass(frozen=True, slots=True)
class Beginning:
    """What a recording begins with: what the loop's clock lacks to Unix time, and the controller's setup as JSON."""

    wall_offset_ns: int
    setup: bytes

    def packed(self) -> bytes:
        """Return it as one message: the first one for the process."""
        return struct.pack("<q", self.wall_offset_ns) + self.setup

    @classmethod
    def unpacked(cls, message: bytes) -> Beginning:
        """Return what `packed` has packed."""
        return cls(struct.unpack_from("<q", message)[0], message[8:])


def run_recorder(
    directory: str, ticks: RingMemory, answers: RingMemory, parts: PartsMemory | None, ready: Event
) -> None:
    """Write until the run says that it has ended, or its process is gone; what it has handed over is kept."""
    from preshape.tools.controller_setup import decode_setup
    from preshape.tools.rerun_content import RerunContent
    from preshape.tools.rerun_layout import blueprint
    from preshape.tools.rerun_stream import RerunStream

    # Ctrl-C is for the run, which then ends the recording; who is terminated beside it completes its files first.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    life = _Life()
    os.nice(NICENESS)
    tick_reader, answer_reader = RingReader(ticks, READER), ByteReader(RingReader(answers, READER, PIECE))
    ready.set()
    first = _first_message(tick_reader, answer_reader, life)
    if not first:
        return
    beginning = Beginning.unpacked(first[0])
    setup = decode_setup(beginning.setup)
    file = RecordingFile(Path(directory, "recording.mcap"), beginning.setup, beginning.wall_offset_ns)
    stream = RerunStream.to_file(Path(directory, "recording.rrd"), blueprint(buses=parts is not None))
    picture = RerunContent(stream, setup.cell, setup.box)
    figures = None if parts is None else PartsReader(parts)
    try:
        for answer, pixels in map(unpack, first[1:]):
            file.add_answer(answer, pixels)
            picture.add_answer(answer, pixels)
        _copy(tick_reader, answer_reader, figures, file, picture, life)
    finally:
        file.close()
        picture.close()


class _Life:
    """Whether the run that is recorded may still have something to say."""

    def __init__(self) -> None:
        self._run = multiprocessing.parent_process()
        self._terminated = threading.Event()
        signal.signal(signal.SIGTERM, lambda number, frame: self._terminated.set())

    @property
    def goes_on(self) -> bool:
        return self._run is not None and self._run.is_alive() and not self._terminated.is_set()


def _first_message(ticks: RingReader, answers: ByteReader, life: _Life) -> list[bytes]:
    """Return the messages from the first one on; none when the run has ended before it began."""
    while True:
        goes_on = life.goes_on
        messages = answers.read()
        if messages or not goes_on or ticks.ended:
            return messages
        time.sleep(NAP_S)


def _copy(
    ticks: RingReader, answers: ByteReader, parts: PartsReader | None, file: RecordingFile, picture: RerunContent,
    life: _Life,
) -> None:  # fmt: skip
    lost, flushed_s = 0, time.monotonic()
    while True:
        goes_on = life.goes_on
        # Ticks first: every answer that they rest on is in the other ring by now, and is written before them.
        records = ticks.read()
        for answer, pixels in map(unpack, answers.read()):
            file.add_answer(answer, pixels)
            picture.add_answer(answer, pixels)
        if ticks.dropped + answers.lost != lost and len(records):
            file.add_gap(int(records["tick"][0]), ticks.dropped + answers.lost - lost)
            lost = ticks.dropped + answers.lost
        file.add_ticks(records)
        picture.add_ticks(records)
        for bus in (parts.newest() or ()) if parts is not None else ():
            picture.add_bus(bus.mono_ns, bus.name, bus.bus_load, bus.bus_errors)
        if time.monotonic() - flushed_s > FLUSH_S:
            file.flush()
            picture.flush()
            flushed_s = time.monotonic()
        if not len(records):
            if ticks.ended or not goes_on:
                return
            time.sleep(NAP_S)
