"""A recording of inputs drawn as if it were running: for the viewer, or to make its picture anew."""

from __future__ import annotations

from collections import deque
from pathlib import Path

from preshape.hal.answers import AnyAnswer, ImageAnswer
from preshape.hal.recording import Recording, read_recording
from preshape.tools.replay_setup import recorded_setup
from preshape.tools.rerun_content import RerunContent
from preshape.tools.rerun_layout import blueprint
from preshape.tools.rerun_stream import RerunStream

BLOCK = 500
"""Ticks drawn at once."""


def show_recording(path: Path, url: str) -> None:
    """Draw a recording into the viewer at a URL; `RecordingError` if it is none."""
    draw_recording(read_recording(path), RerunStream.to_viewer(url, blueprint()))


def draw_recording(recording: Recording, stream: RerunStream) -> None:
    """Draw a recording into a stream, and close it."""
    setup = recorded_setup(recording)
    content = RerunContent(stream, setup.cell, setup.box)
    answers: deque[AnyAnswer] = deque(recording.answers)
    for start in range(0, len(recording.ticks), BLOCK):
        block = recording.ticks[start : start + BLOCK]
        while answers and answers[0].now_ns <= int(block["now_ns"][-1]):
            answer = answers.popleft()
            pixels = recording.images.get(answer.call) if isinstance(answer, ImageAnswer) else None
            content.add_answer(answer, pixels)
        content.add_ticks(block)
        content.flush()
    content.close()
