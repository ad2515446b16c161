"""All that happened in one tick, in one fixed layout of bytes: what observers, recorders and viewers are given.

The loop owns one record and fills it anew each tick; whoever keeps it copies it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.state import RobotCommand, RobotState
from preshape.hal.world import PoseSample

GROUPS = ("palm", "thumb", "fingers")
"""The paper's groups B1, B2, B3: the columns of `group_distance`."""

TEXT_LENGTHS = {"fault": 80, "phase": 32, "mode": 24}
"""Bytes kept of each text; longer ones are cut."""

TICK = np.dtype(
    [
        ("tick", np.int64),
        ("now_ns", np.int64),
        # What the device reported.
        ("status", np.int8),
        ("fault", f"S{TEXT_LENGTHS['fault']}"),
        ("state_sequence", np.int64),
        ("position", np.float64, (LAYOUT.dof,)),
        ("velocity", np.float64, (LAYOUT.dof,)),
        ("torque", np.float64, (LAYOUT.dof,)),
        ("stamp_ns", np.int64, (LAYOUT.dof,)),
        # What was commanded; `taken` says whether the device accepted it.
        ("commanded", np.bool_),
        ("taken", np.bool_),
        ("command_sequence", np.int64),
        ("command_mode", np.int8),
        ("target", np.float64, (LAYOUT.dof,)),
        ("torque_limit", np.float64, (LAYOUT.dof,)),
        ("torque_target", np.float64, (LAYOUT.dof,)),
        # What the controller was doing.
        ("task", np.int16),
        ("phase", f"S{TEXT_LENGTHS['phase']}"),
        ("mode", f"S{TEXT_LENGTHS['mode']}"),
        ("group_distance", np.float64, (len(SIDES), len(GROUPS))),
        ("X_world_object", np.float64, (4, 4)),
        ("object_stamp_ns", np.int64),
        # How the loop kept its time.
        ("lateness_ns", np.int64),
        ("compute_ns", np.int64),
    ],
    align=True,
)
"""One tick; SI units (rad, rad/s, N m, m), times in ns on the loop's clock.

Joint quantities are (40,) in layout order. `group_distance` (2, 3), m: the least distance of each group of
the right and of the left hand to what it must not touch; NaN where it was not evaluated. `X_world_object` is
the estimate used in this tick, as old as now_ns - object_stamp_ns; NaN before the first.
"""

TickRecord = NDArray[np.void]
"""A record: an array of dtype `TICK` without dimensions; a chunk of records has one."""


def new_record() -> TickRecord:
    """Return a record of nothing: numbers zero, lengths and poses NaN, texts empty."""
    record = np.zeros((), TICK)
    for name in ("position", "velocity", "torque", "target", "group_distance", "X_world_object"):
        record[name] = np.nan
    return record


def note_state(record: TickRecord, tick: int, now_ns: int, state: RobotState) -> None:
    """Write down when the tick was and what the device reported."""
    record["tick"], record["now_ns"] = tick, now_ns
    record["status"], record["fault"] = state.status, as_bytes(state.fault)
    record["state_sequence"] = state.sequence
    record["position"], record["velocity"], record["torque"] = state.position, state.velocity, state.torque
    record["stamp_ns"] = state.stamp_ns


def note_command(record: TickRecord, command: RobotCommand | None, taken: bool) -> None:
    """Write down what was commanded; without a command the targets are NaN and the limits zero."""
    record["commanded"], record["taken"] = command is not None, taken
    if command is None:
        record["target"], record["torque_limit"], record["torque_target"] = np.nan, 0.0, 0.0
        record["command_mode"] = 0
        return
    record["command_sequence"], record["command_mode"] = command.sequence, command.mode
    record["target"], record["torque_limit"] = command.position, command.torque_limit
    record["torque_target"] = command.torque


def note_progress(
    record: TickRecord, task: int, phase: str, mode: str, group_distance: ArrayLike, sample: PoseSample | None
) -> None:
    """Write down what the controller was doing, how near its hands (2, 3) were, m, and where it saw the object."""
    record["task"], record["phase"], record["mode"] = task, as_bytes(phase), as_bytes(mode)
    record["group_distance"] = group_distance
    if sample is None:
        record["X_world_object"], record["object_stamp_ns"] = np.nan, 0
    else:
        record["X_world_object"], record["object_stamp_ns"] = sample.X_world_box, sample.stamp_ns


def note_timing(record: TickRecord, lateness_ns: int, compute_ns: int) -> None:
    """Write down how late the tick began and how long it took."""
    record["lateness_ns"], record["compute_ns"] = lateness_ns, compute_ns


def as_bytes(text: str) -> bytes:
    """Return a text as ASCII, with ? for what has no place there."""
    return text.encode("ascii", "replace")


def text_of(record: TickRecord, name: str) -> str:
    """Return one of the record's texts: `fault`, `phase` or `mode`."""
    return bytes(record[name].item()).decode("ascii")
