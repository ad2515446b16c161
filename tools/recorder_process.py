"""The process that writes a run's recording: from two rings in shared memory to two files."""

from __future__ import annotations

import multiprocessing
import os
import signal
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
class Recorded:
    """What is recorded: the folder, the controller's setup as JSON, and what the loop's clock lacks to Unix time."""

    directory: str
    setup: bytes
    wall_offset_ns: int


def run_recorder(job: Recorded, ticks: RingMemory, answers: RingMemory, ready: Event) -> None:
    """Write until the run says that it has ended, or its process is gone; what it has handed over is kept."""
    from preshape.tools.controller_setup import decode_setup
    from preshape.tools.rerun_content import RerunContent
    from preshape.tools.rerun_layout import blueprint
    from preshape.tools.rerun_stream import RerunStream

    # Ctrl-C is for the run, which then ends the recording; who is terminated beside it completes its files first.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    terminated = threading.Event()
    signal.signal(signal.SIGTERM, lambda number, frame: terminated.set())
    os.nice(NICENESS)
    directory, setup = Path(job.directory), decode_setup(job.setup)
    file = RecordingFile(directory / "recording.mcap", job.setup, job.wall_offset_ns)
    stream = RerunStream.to_file(directory / "recording.rrd", blueprint())
    picture = RerunContent(stream, setup.cell, setup.box)
    try:
        ready.set()
        _copy(RingReader(ticks, READER), ByteReader(RingReader(answers, READER, PIECE)), file, picture, terminated)
    finally:
        file.close()
        picture.close()


def _copy(
    ticks: RingReader, answers: ByteReader, file: RecordingFile, picture: RerunContent, terminated: threading.Event
) -> None:
    run = multiprocessing.parent_process()
    lost, flushed_s = 0, time.monotonic()
    while True:
        goes_on = run is not None and run.is_alive() and not terminated.is_set()
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
        if time.monotonic() - flushed_s > FLUSH_S:
            file.flush()
            picture.flush()
            flushed_s = time.monotonic()
        if not len(records):
            if ticks.ended or not goes_on:
                return
            time.sleep(NAP_S)
