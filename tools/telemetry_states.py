"""From a tick record to the messages of the state streams: pure functions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from preshape.hal.layout import LAYOUT, SIDES, Side
from preshape.hal.sah_hand import FINGERS
from preshape.hal.state import DeviceStatus
from preshape.hal.tick_record import GROUPS, TickRecord, text_of
from preshape.hal.transform import Matrix, quaternion_xyzw
from preshape.tools.telemetry_keys import LIMBS
from preshape.tools.telemetry_messages import (
    AimState,
    GroupState,
    JointsState,
    Message,
    Number,
    ObjectState,
    Point,
    TaskState,
)

TASK_NAMES = {1: "grasp", 2: "find opening", 3: "regrasp", 4: "crush", 5: "open"}
"""What the tasks are called; any other number is no task."""


@dataclass(frozen=True, slots=True)
class Stamps:
    """How a stream's messages are numbered and dated.

    `wall_offset_ns` is what the loop's clock lacks to Unix time.
    """

    seq: int
    wall_offset_ns: int = 0


def joints_state(record: TickRecord, side: Side, limb: str, stamps: Stamps) -> JointsState:
    """Return what one arm or hand measures and was commanded."""
    joints = LAYOUT.arm(side) if limb == "arm" else LAYOUT.hand(side)
    return JointsState(
        **_stamped(record, stamps),
        name=list(LAYOUT.names[joints]),
        position=numbers(record["position"][joints]),
        velocity=numbers(record["velocity"][joints]),
        effort=numbers(record["torque"][joints]),
        target=numbers(record["target"][joints]),
        effort_limit=numbers(record["torque_limit"][joints]),
        age_s=_age_s(record, int(record["stamp_ns"][joints].min())),
    )


def object_state(record: TickRecord, stamps: Stamps) -> ObjectState:
    """Return where the object is taken to be."""
    X: Matrix = record["X_world_object"]
    if np.isnan(X[0, 0]):
        pose: dict[str, Any] = {"source": "none", "position": None, "orientation_xyzw": None, "age_s": None}
    else:
        pose = {
            "source": "perception",
            "position": numbers(X[:3, 3]),
            "orientation_xyzw": numbers(quaternion_xyzw(X[:3, :3])),
            "age_s": _age_s(record, int(record["object_stamp_ns"])),
        }
    return ObjectState(**_stamped(record, stamps), frame="world", **pose)


def task_state(record: TickRecord, stamps: Stamps) -> TaskState:
    """Return what the controller is doing."""
    task = int(record["task"])
    return TaskState(
        **_stamped(record, stamps),
        task=task,
        task_name=TASK_NAMES.get(task, ""),
        phase=text_of(record, "phase"),
        mode=text_of(record, "mode"),
        status=DeviceStatus(int(record["status"])).name,
        fault=text_of(record, "fault"),
        groups={side: _groups(record, hand) for hand, side in enumerate(SIDES)},
        aims={side: aim for hand, side in enumerate(SIDES) if (aim := _aim(record, hand)) is not None},
        held=bool(record["held"]),
    )


def state_of(record: TickRecord, tail: str, stamps: Stamps) -> Message:
    """Return the message for the state key with this tail; `KeyError` names the ones there are."""
    if tail == "state/object":
        return object_state(record, stamps)
    if tail == "state/task":
        return task_state(record, stamps)
    for side in SIDES:
        for limb in LIMBS:
            if tail == f"state/{side}/{limb}":
                return joints_state(record, side, limb, stamps)
    raise KeyError(f"{tail} is no state stream, there are {', '.join(STATES)}")


STATES = (*(f"state/{side}/{limb}" for side in SIDES for limb in LIMBS), "state/object", "state/task")
"""Tails of all state streams."""


def numbers(values: Iterable[float] | NDArray[np.float64]) -> list[Number]:
    """Return values as JSON can hold them: what is NaN or infinite becomes None."""
    return [value if math.isfinite(value) else None for value in np.asarray(values, np.float64).ravel().tolist()]


def _groups(record: TickRecord, hand: int) -> dict[str, GroupState]:
    distances = numbers(record["group_distance"][hand])
    points, forces = record["group_point"][hand], record["group_force"][hand]
    return {
        name: GroupState(distance=distances[k], point=_known(points[k]), force=_known(forces[k]))
        for k, name in enumerate(GROUPS)
    }


def _aim(record: TickRecord, hand: int) -> AimState | None:
    """Return what a hand is on its way to, None if to nothing."""
    tips, X = record["tip_target"][hand], record["X_world_preshape"][hand]
    if np.isnan(tips[0, 0]):
        return None
    targets = {finger: numbers(tips[k]) for k, finger in enumerate(FINGERS)}
    if np.isnan(X[0, 0]):
        return AimState(tips=targets)
    return AimState(
        tips=targets,
        box_position=numbers(X[:3, 3]),
        box_orientation_xyzw=numbers(quaternion_xyzw(X[:3, :3])),
        box_size=numbers(2.0 * record["preshape_half"][hand]),
    )


def _known(point: NDArray[np.float64]) -> Point | None:
    return None if np.isnan(point[0]) else numbers(point)


def _stamped(record: TickRecord, stamps: Stamps) -> dict[str, Any]:
    now_ns = int(record["now_ns"])
    return {
        "seq": stamps.seq,
        "stamp_ns": now_ns + stamps.wall_offset_ns,
        "mono_ns": now_ns,
        "tick": int(record["tick"]),
    }


def _age_s(record: TickRecord, stamp_ns: int) -> float:
    return (int(record["now_ns"]) - stamp_ns) * 1e-9
