"""The plots of a recording: which numbers are drawn from the records, under which names and in which colours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from preshape.hal import sah_hand
from preshape.hal.layout import LAYOUT, SIDES, Side, hand_joint_names
from preshape.hal.tick_record import GROUPS, TickRecord

COLORS = (0x4C72B0FF, 0xDD8452FF, 0x55A868FF, 0xC44E52FF, 0x8172B3FF, 0x937860FF)
"""Line colours, 0xRRGGBBAA, in the order of use."""
MOST_LOOP_US = 4000.0
"""Where the loop's times are cut off in the viewer, us: two periods. In lockstep planning takes up to seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Lines of one plot: where they belong, their names, and their values (n, lines).

    Colours are those of `COLORS` from `color` on, for lines that share a plot with other series.
    """

    path: str
    names: tuple[str, ...]
    values: NDArray[np.float64]
    color: int = 0

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.values.shape[1] != len(self.names):
            raise ValueError(f"{self.path}: values {self.values.shape} do not fit the {len(self.names)} names")


def torque_ratios(records: TickRecord, side: Side) -> Series:
    """Return the greatest |torque| / torque limit among each finger's joints and among the arm's, 1 = at the limit."""
    ratio = np.abs(records["torque"]) / LAYOUT.torque
    parts = [LAYOUT.finger(side, finger) for finger in sah_hand.FINGERS] + [LAYOUT.arm(side)]
    names = (*sah_hand.FINGERS, "arm")
    return Series(f"{side}/torque_ratio", names, np.column_stack([ratio[:, part].max(1) for part in parts]))


def finger_torques(records: TickRecord, side: Side, finger: str) -> Series:
    """Return the torques of one finger's joints and, as two more lines, the greatest limit it may use now, N m."""
    joints = LAYOUT.finger(side, finger)
    limit = records["torque_limit"][:, joints].max(1)
    local = slice(joints.start - LAYOUT.hand(side).start, joints.stop - LAYOUT.hand(side).start)
    names = tuple(name.rsplit("_", 1)[-1] for name in hand_joint_names(side)[local])
    values = np.column_stack([records["torque"][:, joints], limit, -limit])
    return Series(f"{side}/{finger}/torque", (*names, "limit", "-limit"), values)


def distances(records: TickRecord, side: Side) -> Series:
    """Return the distance of each group of a hand to what it must not touch, m."""
    return Series(f"{side}/distance", GROUPS, records["group_distance"][:, SIDES.index(side)])


def tracking_errors(records: TickRecord, side: Side) -> Series:
    """Return the greatest |target - position| among the arm's and among the hand's joints, rad."""
    error = np.abs(records["target"] - records["position"])
    values = np.column_stack([error[:, part].max(1) for part in (LAYOUT.arm(side), LAYOUT.hand(side))])
    return Series(f"{side}/tracking_error", ("arm", "hand"), values)


def ages(records: TickRecord) -> Series:
    """Return how old each limb's oldest joint sample and the object's pose were when they were used, ms."""
    limbs = {f"{side} {limb}": part for side in SIDES for limb, part in _limbs(side).items()}
    oldest = np.column_stack([records["stamp_ns"][:, part].min(1) for part in limbs.values()])
    joints = (records["now_ns"][:, None] - oldest) * 1e-6
    seen = ~np.isnan(records["X_world_object"][:, 0, 0])
    pose = np.where(seen, (records["now_ns"] - records["object_stamp_ns"]) * 1e-6, np.nan)
    return Series("loop/age", (*limbs, "object pose"), np.column_stack([joints, pose]))


def _limbs(side: Side) -> dict[str, slice]:
    return {"arm": LAYOUT.arm(side), "hand": LAYOUT.hand(side)}


def loop_times(timing: NDArray[np.void]) -> Series:
    """Return every tick's lateness and compute time, us."""
    values = np.column_stack([timing["lateness_ns"], timing["compute_ns"]]) * 1e-3
    return Series("loop/timing", ("lateness", "compute"), values)


def cut_off(series: Series, highest: float) -> Series:
    """Return a series whose greater values stand at `highest`: single ones must not hide all others."""
    return Series(series.path, series.names, np.minimum(series.values, highest))


def bus_series(number: int, name: str, load: float, errors: int) -> list[Series]:
    """Return what share of its time a device's bus of this number takes, and its error frames so far: one moment."""
    lines = {"load": float(load), "errors": float(errors)}
    return [Series(f"bus/{what}/{name}", (name,), np.array([[value]]), number) for what, value in lines.items()]


def record_series(records: TickRecord) -> list[Series]:
    """Return all plots drawn from whole records."""
    series = [ages(records)]
    for side in SIDES:
        series += [torque_ratios(records, side), distances(records, side), tracking_errors(records, side)]
        series += [finger_torques(records, side, finger) for finger in sah_hand.FINGERS]
    return series


def changes(values: NDArray[np.generic]) -> NDArray[np.int64]:
    """Return the indices where a column (n,) takes a new value, the first among them."""
    if len(values) == 0:
        return np.zeros(0, np.int64)
    return np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1])
