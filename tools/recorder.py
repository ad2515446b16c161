"""A run's recorder as the run sees it: it hands over what happens, and a process of its own writes the files."""

from __future__ import annotations

import multiprocessing
import time
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from preshape.hal.answers import AnyAnswer
from preshape.hal.byte_ring import CAPACITY, PIECE, ByteWriter
from preshape.hal.tick_record import TickRecord
from preshape.hal.tick_ring import RingWriter, ring_memory
from preshape.hal.waiting_ring import WaitingRingWriter
from preshape.tools.answer_pack import pack
from preshape.tools.child_process import await_end, start
from preshape.tools.controller_setup import ControllerSetup, encode_setup
from preshape.tools.part_figures import PartsMemory, parts_memory
from preshape.tools.recorder_process import READER, Beginning, run_recorder

PATIENCE_S = 30.0
"""How long a run in lockstep waits for a process that takes nothing, s."""
FINISH_S = 120.0
"""Longest time that it may take to write what is left, s."""

FILES = {"recording": "recording.rrd", "inputs": "recording.mcap"}
"""What is written into the run's folder."""


class Recorder:
    """An observer, and the listener of a `RecordedPerception`: `start`, `begin`, the run; leaving it ends them.

    In lockstep the run waits for the recorder when that is slower; in a paced run nothing waits, and what could not
    be handed over is a gap in the recording. When the run is killed, the recorder completes its files.
    """

    def __init__(self, directory: Path) -> None:
        """Write into a folder that exists."""
        self._directory = directory
        self._process: BaseProcess | None = None
        self._ticks: RingWriter | WaitingRingWriter | None = None
        self._answers: ByteWriter | None = None
        self.parts: PartsMemory | None = None

    def start(self, paced: bool, buses: bool = False) -> None:
        """Start the process that writes and wait until it is up: before the world is, whose time would go on.

        With `buses` the picture has room for how the device's are, which `parts` is to be told.

        Raises:
            DeviceUnreachable: it does not come up.
        """
        context = multiprocessing.get_context("spawn")
        ticks, answers = ring_memory(context), ring_memory(context, CAPACITY, PIECE)
        if paced:
            self._ticks, pieces = RingWriter(ticks), RingWriter(answers, PIECE)
        else:
            self._ticks, pieces = WaitingRingWriter(ticks, PATIENCE_S), WaitingRingWriter(answers, PATIENCE_S, PIECE)
            for writer in (self._ticks, pieces):
                writer.keep_for(READER)
        self._answers = ByteWriter(pieces)
        self.parts = parts_memory(context) if buses else None
        ready = context.Event()
        arguments = str(self._directory), ticks, answers, self.parts, ready
        self._process = context.Process(name="recorder", target=run_recorder, args=arguments, daemon=True)
        start(self._process, ready)

    def begin(self, setup: ControllerSetup) -> None:
        """Say what the controller is given, before it asks anything or ticks: the files begin with it."""
        if self._answers is not None:
            # Paced runs live on the machine's clock, the others begin at zero.
            wall_offset_ns = time.time_ns() - (time.monotonic_ns() if setup.paced else 0)
            self._answers.send(Beginning(wall_offset_ns, encode_setup(setup)).packed())

    @property
    def note(self) -> str:
        """What went wrong with the process so far, in one line; empty if nothing did."""
        if self._process is None or self._process.exitcode in (None, 0):
            return ""
        return f"recorder: its process ended with exit code {self._process.exitcode}"

    def notify(self, record: TickRecord) -> None:
        """Hand over one tick."""
        if self._ticks is not None:
            self._ticks.notify(record)

    def hear(self, answer: AnyAnswer, pixels: NDArray[np.uint8] | None) -> None:
        """Hand over one answer of the perception."""
        if self._answers is not None:
            self._answers.send(pack(answer, pixels))

    def finish(self) -> None:
        """End the recording and wait until it is written; may be called twice."""
        if self._ticks is None or self._process is None:
            return
        self._ticks.end()
        await_end(self._process, FINISH_S)

    @property
    def files(self) -> dict[str, Path]:
        """What has been written, by name."""
        paths = {name: self._directory / file for name, file in FILES.items()}
        started = self._process is not None
        return {name: path for name, path in paths.items() if started and path.exists()}

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *cause: object) -> None:
        self.finish()
