"""All that happened in one tick, in one fixed layout of bytes: what observers, recorders and viewers are given.

The loop owns one record and fills it anew each tick; whoever keeps it copies it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal.layout import LAYOUT, SIDES, Side
from preshape.hal.sah_hand import FINGERS
from preshape.hal.state import RobotCommand, RobotState
from preshape.hal.world import FACES, Opening, PoseSample

GROUPS = ("palm", "thumb", "fingers")
"""The paper's groups B1, B2, B3: the columns of `group_distance`."""

TEXT_LENGTHS = {"fault": 80, "stop_reason": 80, "phase": 32, "mode": 24}
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
        # What the operator, or a service, had asked for when the tick began.
        ("stop_reason", f"S{TEXT_LENGTHS['stop_reason']}"),
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
        ("begun", np.bool_),
        ("held", np.bool_),
        ("group_distance", np.float64, (len(SIDES), len(GROUPS))),
        ("group_point", np.float64, (len(SIDES), len(GROUPS), 3)),
        ("group_force", np.float64, (len(SIDES), len(GROUPS), 3)),
        ("X_world_preshape", np.float64, (len(SIDES), 4, 4)),
        ("preshape_half", np.float64, (len(SIDES), 3)),
        ("tip_target", np.float64, (len(SIDES), len(FINGERS), 3)),
        ("opening_face", np.int8),
        ("opening_edge", np.int8),
        ("opening_offset", np.float64),
        ("X_world_object", np.float64, (4, 4)),
        ("object_stamp_ns", np.int64),
        # How the loop kept its time.
        ("lateness_ns", np.int64),
        ("compute_ns", np.int64),
    ],
    align=True,
)
"""One tick; SI units (rad, rad/s, N m, m), times in ns on the loop's clock.

Joint quantities are (40,) in layout order. `stop_reason` is empty until a stop is asked for. `begun`: a step of
a controller that thinks beside the loop was begun in this tick; `held`: it was still thinking, and what moved was
braked. `group_distance` (2, 3), m: the least distance of each group of the right and of the left hand to what it must
not touch; `group_point`, m, and `group_force`, N: the reciprocal point there and the force on the group, in the world;
NaN where they were not evaluated.
`X_world_preshape`, `preshape_half` (m) and `tip_target` (m, in the world): the preshaping box that each hand is on
its way to and where its fingertips shall be; NaN when there is none. `opening_face` and `opening_edge`: where the
opening was found, as indices of `world.FACES`, -1 before; `opening_offset`, m. `X_world_object` is the estimate used
in this tick, as old as now_ns - object_stamp_ns; NaN before the first.
"""

FIELD_ARRAYS = ("group_distance", "group_point", "group_force")
"""What the field says of each group; in the order of `note_field`."""
AIM_ARRAYS = ("X_world_preshape", "preshape_half", "tip_target")
"""What a hand is on its way to; in the order of `note_aim`."""

TickRecord = NDArray[np.void]
"""A record: an array of dtype `TICK` without dimensions; a chunk of records has one."""


def new_record() -> TickRecord:
    """Return a record of nothing: numbers zero, lengths and poses NaN, texts empty."""
    record = np.zeros((), TICK)
    for name in ("position", "velocity", "torque", "target", *FIELD_ARRAYS, *AIM_ARRAYS, "X_world_object"):
        record[name] = np.nan
    note_opening(record, None)
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


def note_stop(record: TickRecord, reason: str) -> None:
    """Write down which stop had been asked for when the tick began; an empty text if none."""
    record["stop_reason"] = as_bytes(reason)


def note_progress(record: TickRecord, task: int, phase: str, mode: str, sample: PoseSample | None) -> None:
    """Write down what the controller was doing, and where it saw the object."""
    record["task"], record["phase"], record["mode"] = task, as_bytes(phase), as_bytes(mode)
    if sample is None:
        record["X_world_object"], record["object_stamp_ns"] = np.nan, 0
    else:
        record["X_world_object"], record["object_stamp_ns"] = sample.X_world_box, sample.stamp_ns


def note_opening(record: TickRecord, opening: Opening | None) -> None:
    """Write down where the object's opening has been found; None before."""
    known = opening is not None
    record["opening_face"], record["opening_edge"] = (
        (FACES.index(opening.face), FACES.index(opening.edge)) if known else (-1, -1)
    )
    record["opening_offset"] = opening.offset if known else np.nan


def note_field(record: TickRecord, distance: ArrayLike, point: ArrayLike, force: ArrayLike) -> None:
    """Write down each group's distance (2, 3), m, reciprocal point (2, 3, 3), m, and force (2, 3, 3), N; NaN: none."""
    record["group_distance"], record["group_point"], record["group_force"] = distance, point, force


def note_aim(record: TickRecord, side: Side, X_world_preshape: ArrayLike, half: ArrayLike, tips: ArrayLike) -> None:
    """Write down a hand's preshaping box (pose; half edges (3,), m) and fingertip targets (4, 3), m; NaN: none."""
    hand = SIDES.index(side)
    record["X_world_preshape"][hand], record["preshape_half"][hand] = X_world_preshape, half
    record["tip_target"][hand] = tips


def note_timing(record: TickRecord, lateness_ns: int, compute_ns: int) -> None:
    """Write down how late the tick began and how long it took."""
    record["lateness_ns"], record["compute_ns"] = lateness_ns, compute_ns


def as_bytes(text: str) -> bytes:
    """Return a text as ASCII, with ? for what has no place there."""
    return text.encode("ascii", "replace")


def text_of(record: TickRecord, name: str) -> str:
    """Return one of the record's texts, the keys of `TEXT_LENGTHS`."""
    return bytes(record[name].item()).decode("ascii")
