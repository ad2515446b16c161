"""Tick records put together again from what is published: what a viewer or recorder far from the loop works with."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.sah_hand import FINGERS
from preshape.hal.state import DeviceStatus
from preshape.hal.tick_record import GROUPS, TickRecord, as_bytes, new_record, note_opening
from preshape.hal.transform import Matrix, rotation_xyzw, transform
from preshape.hal.world import FACES, Face, Opening
from preshape.tools.telemetry_messages import (
    AimState,
    JointsState,
    Message,
    ObjectState,
    Point,
    SceneState,
    TaskState,
)

LATE_NS = 1_000_000_000
"""A message older than the newest by more than this comes from a run before, ns."""


class RecordBuilder:
    """Joins the messages of one moment: `add` each, take the records of the moments before from `records`.

    A record is complete when a message of a later moment comes. What is published more seldom (the task) stays as it
    was last. What is not published at all (sequences, the loop's times) is zero.
    """

    def __init__(self) -> None:
        """Begin with nothing known."""
        self._record = new_record()
        self._moved = False
        self._done: list[TickRecord] = []

    def add(self, message: Message) -> None:
        """Take one message of a state stream; others are left alone."""
        if not isinstance(message, JointsState | ObjectState | TaskState | SceneState):
            return
        newest_ns = int(self._record["now_ns"])
        if message.mono_ns < newest_ns - LATE_NS:
            # A new run: its clock has begun anew.
            self._record, self._moved = new_record(), False
        elif message.mono_ns > newest_ns:
            self._finish()
        if message.mono_ns >= int(self._record["now_ns"]):
            self._record["now_ns"] = message.mono_ns
            self._take(message)

    def records(self) -> TickRecord:
        """Return the records (n,) completed since the last call, oldest first."""
        done, self._done = self._done, []
        return np.array(done, self._record.dtype)

    def _finish(self) -> None:
        if self._moved:
            self._done.append(self._record.copy())
        self._moved = False

    def _take(self, message: JointsState | ObjectState | TaskState | SceneState) -> None:
        match message:
            case JointsState():
                self._moved = True
                _take_joints(self._record, message)
            case ObjectState():
                _take_object(self._record, message)
            case TaskState():
                _take_task(self._record, message)
            case SceneState():
                note_opening(self._record, _opening(message))
        if not isinstance(message, SceneState):
            self._record["tick"] = message.tick


@lru_cache(maxsize=16)
def _joints(names: tuple[str, ...]) -> NDArray[np.int64]:
    return np.array([LAYOUT.index(name) for name in names], dtype=np.int64)


def _take_joints(record: TickRecord, message: JointsState) -> None:
    joints = _joints(tuple(message.name))
    columns = {
        "position": message.position,
        "velocity": message.velocity,
        "torque": message.effort,
        "target": message.target,
        "torque_limit": message.effort_limit,
    }
    for name, values in columns.items():
        record[name][joints] = _array(values)
    record["stamp_ns"][joints] = message.mono_ns - round(message.age_s * 1e9)


def _take_object(record: TickRecord, message: ObjectState) -> None:
    if message.position is None or message.orientation_xyzw is None or message.age_s is None:
        record["X_world_object"], record["object_stamp_ns"] = np.nan, 0
        return
    record["X_world_object"] = _matrix(message.position, message.orientation_xyzw)
    record["object_stamp_ns"] = message.mono_ns - round(message.age_s * 1e9)


def _take_task(record: TickRecord, message: TaskState) -> None:
    record["task"], record["phase"], record["mode"] = message.task, as_bytes(message.phase), as_bytes(message.mode)
    record["status"], record["fault"] = DeviceStatus[message.status], as_bytes(message.fault)
    record["held"] = message.held
    for hand, side in enumerate(SIDES):
        for number, group in enumerate(GROUPS):
            state = message.groups[side][group]
            record["group_distance"][hand, number] = np.nan if state.distance is None else state.distance
            record["group_point"][hand, number] = np.nan if state.point is None else _array(state.point)
            record["group_force"][hand, number] = np.nan if state.force is None else _array(state.force)
        _take_aim(record, hand, message.aims.get(side))


def _take_aim(record: TickRecord, hand: int, aim: AimState | None) -> None:
    record["tip_target"][hand] = record["X_world_preshape"][hand] = record["preshape_half"][hand] = np.nan
    if aim is None:
        return
    record["tip_target"][hand] = [_array(aim.tips[finger]) for finger in FINGERS]
    if aim.box_position is not None and aim.box_orientation_xyzw is not None and aim.box_size is not None:
        record["X_world_preshape"][hand] = _matrix(aim.box_position, aim.box_orientation_xyzw)
        record["preshape_half"][hand] = _array(aim.box_size) / 2.0


def _opening(message: SceneState) -> Opening | None:
    found = message.opening
    if found is None:
        return None
    faces: dict[str, Face] = {face: face for face in FACES}
    return Opening(faces[found.face], faces[found.edge], found.offset)


def _array(values: Point) -> Matrix:
    return np.array(values, float)


def _matrix(position: Point, orientation_xyzw: Point) -> Matrix:
    return transform(_array(position), rotation_xyzw(_array(orientation_xyzw)))
