"""What a recording shows of a run: plots, states, events and the scene, drawn from the records kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from preshape.hal.state import DeviceStatus
from preshape.hal.tick_record import TickRecord
from preshape.hal.world import NominalBox, Workcell
from preshape.tools.rerun_file import RerunFile
from preshape.tools.rerun_scene import add_robot, add_surroundings
from preshape.tools.series import changes, loop_times, record_series

MOTION_INTERVAL_S = 0.04
"""The scene moves in steps of this interval, s."""


def texts(column: NDArray[np.bytes_]) -> NDArray[np.str_]:
    """Return a text column of the records as strings; an empty text reads `-`."""
    decoded = np.char.decode(column, "ascii")
    return np.where(decoded == "", "-", decoded)


def add_progress(file: RerunFile, records: TickRecord) -> None:
    """Add task, phase, mode and device status as states, and their changes and the faults as events."""
    now_ns = records["now_ns"]
    status = np.array([DeviceStatus(value).name.lower() for value in records["status"].tolist()])
    task = np.array([f"task {value}" for value in records["task"].tolist()])
    phase, mode, fault = texts(records["phase"]), texts(records["mode"]), texts(records["fault"])
    for path, values in (("task", task), ("phase", phase), ("mode", mode), ("device", status)):
        file.add_states(path, now_ns, values)
    at = changes(np.array([" ".join(row) for row in zip(task, phase, mode, status, fault, strict=True)]))
    lines = [f"{task[i]}: {phase[i]}, {mode[i]}, device {status[i]}" for i in at]
    faulty = [fault[i] != "-" for i in at]
    lines = [f"{line}: {fault[i]}" if bad else line for line, i, bad in zip(lines, at, faulty, strict=True)]
    file.add_events(now_ns[at], lines, ["ERROR" if bad else "INFO" for bad in faulty])


def thinned(records: TickRecord, interval_s: float) -> TickRecord:
    """Return records at least `interval_s` apart, the first and the last among them."""
    if len(records) == 0:
        return records
    slot = (records["now_ns"] - records["now_ns"][0]) // round(interval_s * 1e9)
    keep = np.append(changes(slot), len(records) - 1)
    return records[np.unique(keep)]


def write_recording(
    path: Path, records: TickRecord, timing: NDArray[np.void], workcell: Workcell, box: NominalBox
) -> Path:
    """Write records (n,) and timing (m,) to an .rrd file and return its path."""
    if len(records) == 0:
        raise ValueError("a recording needs at least one record")
    file = RerunFile(path, int(records["now_ns"][0]))
    for series in record_series(records):
        file.add_series(series, records["now_ns"])
    file.add_series(loop_times(timing), timing["now_ns"])
    add_progress(file, records)
    motion = thinned(records, MOTION_INTERVAL_S)
    add_surroundings(file, motion, workcell, box)
    add_robot(file, motion, workcell)
    file.close()
    return path
