"""Laws of the recorder: what a killed run leaves can be opened and holds all but its last second."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from preshape.hal.answers import encode_answer
from preshape.hal.recording import RecordingError, read_recording
from preshape.hal.recording_file import RecordingFile
from preshape.hal.tick_record import TICK
from preshape.tools.recording_repair import complete_recording

WORKER = Path(__file__).with_name("recorded_process.py")
RERUN = (sys.executable, "-m", "rerun")


def passes(*command: str) -> bool:
    """Tell whether rerun calls a file right."""
    return subprocess.run([*RERUN, *command], capture_output=True, check=False).returncode == 0


def killed_after(seconds: float, directory: Path, whole_group: bool, by: int = signal.SIGKILL) -> int:
    """Record for a while, end the process (with its recorder, or alone), and return when that was, monotonic ns."""
    process = subprocess.Popen(
        [sys.executable, str(WORKER), str(directory)], stdout=subprocess.PIPE, start_new_session=True
    )
    assert process.stdout is not None and process.stdout.readline() == b"ready\n"
    time.sleep(seconds)
    at_ns = time.monotonic_ns()
    (os.killpg if whole_group else os.kill)(process.pid, by)
    process.wait()
    process.stdout.close()
    return at_ns


@pytest.mark.slow
@pytest.mark.parametrize(("whole_group", "by"), [(False, signal.SIGKILL), (True, signal.SIGTERM)])
def test_a_run_that_is_killed_or_terminated_leaves_whole_files(tmp_path: Path, whole_group: bool, by: int) -> None:
    at_ns = killed_after(2.5, tmp_path, whole_group, by)
    deadline_s = time.monotonic() + 30.0
    while not passes("mcap", "check", str(tmp_path / "recording.mcap")):
        assert time.monotonic() < deadline_s, "the recorder did not complete its file"
        time.sleep(0.5)
    recording = read_recording(tmp_path / "recording.mcap")
    assert recording.complete and recording.gap is None
    assert np.array_equal(recording.ticks["tick"], np.arange(len(recording.ticks)))
    assert at_ns - int(recording.ticks["now_ns"][-1]) < 1.0e9
    assert {answer.call for answer in recording.answers} >= set(recording.ticks["tick"].tolist())
    while not passes("rrd", "verify", str(tmp_path / "recording.rrd")):
        assert time.monotonic() < deadline_s, "the recorder did not complete its picture"
        time.sleep(0.5)


@pytest.mark.slow
def test_what_a_killed_recorder_has_written_is_read_back_but_for_the_last_second(tmp_path: Path) -> None:
    at_ns = killed_after(2.5, tmp_path, whole_group=True)
    recording = read_recording(tmp_path / "recording.mcap")
    assert not recording.complete
    assert at_ns - int(recording.ticks["now_ns"][-1]) < 1.0e9
    assert {answer.call for answer in recording.answers} >= set(recording.ticks["tick"].tolist())
    assert complete_recording(tmp_path).ticks.tobytes() == recording.ticks.tobytes()
    again = read_recording(tmp_path / "recording.mcap")
    assert again.complete and again.ticks.tobytes() == recording.ticks.tobytes() and again.setup == recording.setup
    assert [encode_answer(answer) for answer in again.answers] == [encode_answer(a) for a in recording.answers]
    assert passes("mcap", "check", str(tmp_path / "recording.mcap"))
    assert passes("rrd", "verify", str(tmp_path / "recording.rrd"))


def write_ticks(path: Path, count: int) -> bytes:
    """Write a recording of so many ticks, some of them lost, and return its bytes."""
    file = RecordingFile(path, b'{"name": "test"}')
    ticks = np.zeros(count, TICK)
    ticks["tick"], ticks["now_ns"] = np.arange(count), 2_000_000 * np.arange(count)
    for block in np.split(ticks, range(50, count, 50)):
        file.add_ticks(block)
        file.flush()
    file.close()
    return path.read_bytes()


def test_a_file_cut_anywhere_is_read_up_to_there(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    data = write_ticks(path, 200)
    seen = 0
    for size in np.linspace(3000, len(data), 40).astype(int):
        path.write_bytes(data[:size])
        recording = read_recording(path)
        assert len(recording.ticks) % 50 == 0 and len(recording.ticks) >= seen
        assert np.array_equal(recording.ticks["tick"], np.arange(len(recording.ticks)))
        assert recording.complete == (size == len(data))
        seen = len(recording.ticks)
    assert seen == 200


def test_lost_ticks_are_said(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    file = RecordingFile(path, b"{}")
    file.add_gap(17, 3)
    file.close()
    assert read_recording(path).gap == 17


@pytest.mark.parametrize("content", [b"", b"no recording", b"\x89MCAP0\r\n"], ids=["empty", "text", "head alone"])
def test_a_file_that_is_no_recording_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="other.mcap"):
        read_recording(path)
    with pytest.raises(RecordingError, match="cannot be read"):
        read_recording(tmp_path / "missing.mcap")
