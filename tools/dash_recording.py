"""A recording of inputs drawn as if it were running: for the viewer, or to make its picture anew."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import numpy as np

from preshape.hal.answers import AnyAnswer
from preshape.hal.recording import Recording, read_recording
from preshape.hal.tick_record import TickRecord
from preshape.tools.replay_setup import recorded_setup
from preshape.tools.rerun_content import RerunContent
from preshape.tools.rerun_layout import blueprint
from preshape.tools.rerun_stream import RerunStream

BLOCK = 250
"""Ticks drawn at once."""


class RecordingDrawer:
    """Draws ticks into a stream, and what the recording's controller had been told by each of them.

    An observer, too: of a replay, whose ticks need not be the recorded ones.
    """

    def __init__(self, recording: Recording, stream: RerunStream) -> None:
        """Draw around what the recorded controller knew."""
        setup = recorded_setup(recording)
        self._content = RerunContent(stream, setup.cell, setup.box)
        self._answers: deque[AnyAnswer] = deque(recording.answers)
        self._recording = recording
        self._block: list[TickRecord] = []

    def notify(self, record: TickRecord) -> None:
        """Take one tick; draws now and then."""
        self._block.append(record.copy())
        if len(self._block) == BLOCK:
            self._flush()

    def add_ticks(self, records: TickRecord) -> None:
        """Draw records (n,), n >= 1."""
        while self._answers and self._answers[0].now_ns <= int(records["now_ns"][-1]):
            answer = self._answers.popleft()
            self._content.add_answer(answer, self._recording.pixels(answer))
        self._content.add_ticks(records)
        self._content.flush()

    def close(self) -> None:
        """Draw what is left and end the stream."""
        if self._block:
            self._flush()
        self._content.close()

    def _flush(self) -> None:
        self.add_ticks(np.array(self._block))
        self._block = []


def draw_recording(recording: Recording, stream: RerunStream) -> None:
    """Draw a recording into a stream, and close it."""
    drawer = RecordingDrawer(recording, stream)
    for start in range(0, len(recording.ticks), BLOCK):
        drawer.add_ticks(recording.ticks[start : start + BLOCK])
    drawer.close()


def show_recording(path: Path, url: str) -> None:
    """Draw a recording into the viewer at a URL; `RecordingError` if it is none."""
    draw_recording(read_recording(path), RerunStream.to_viewer(url, blueprint()))
