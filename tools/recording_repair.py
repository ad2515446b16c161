"""What a killed recorder has left, made whole: files that every viewer opens, with all that was complete in them."""

from __future__ import annotations

import os
from collections import deque
from pathlib import Path

from preshape.hal.answers import AnyAnswer
from preshape.hal.recording import Recording, read_recording
from preshape.hal.recording_file import RecordingFile
from preshape.tools.dash_recording import draw_recording
from preshape.tools.rerun_layout import blueprint
from preshape.tools.rerun_stream import RerunStream

BLOCK = 500
"""Ticks written at once."""


def complete_recording(directory: Path) -> Recording:
    """Write recording.mcap and recording.rrd of a run's folder anew from what can be read, and return that.

    Both are replaced only when the new ones are whole. `RecordingError` if there is nothing to be read.
    """
    inputs, picture = directory / "recording.mcap", directory / "recording.rrd"
    recording = read_recording(inputs)
    new_inputs, new_picture = inputs.with_suffix(".new.mcap"), picture.with_suffix(".new.rrd")
    if not recording.complete:
        write_recording(recording, new_inputs)
        os.replace(new_inputs, inputs)
    draw_recording(recording, RerunStream.to_file(new_picture, blueprint()))
    os.replace(new_picture, picture)
    return recording


def write_recording(recording: Recording, path: Path) -> None:
    """Write a recording to a file."""
    file = RecordingFile(path, recording.setup, recording.wall_offset_ns)
    answers: deque[AnyAnswer] = deque(recording.answers)
    if recording.gap is not None:
        file.add_gap(recording.gap, recording.lost)
    for start in range(0, len(recording.ticks), BLOCK):
        block = recording.ticks[start : start + BLOCK]
        while answers and answers[0].now_ns <= int(block["now_ns"][-1]):
            answer = answers.popleft()
            file.add_answer(answer, recording.pixels(answer))
        file.add_ticks(block)
    for answer in answers:
        file.add_answer(answer, recording.pixels(answer))
    file.close()
