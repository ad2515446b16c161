"""What a device reports and what it accepts: frozen values, arrays copied in and read-only, SI units."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal.layout import LAYOUT

Vector = NDArray[np.float64]


class DeviceStatus(IntEnum):
    """Where a device is in its life; only ARMED devices move."""

    DISARMED = 0
    ARMED = 1
    STOPPED = 2
    FAULT = 3


class Mode(IntEnum):
    """What the joint modules do with a command."""

    DISABLED = 0
    HOLD = 1
    POSITION = 2
    TORQUE = 3
    BRAKE = 4


def read_only(values: ArrayLike, name: str, dtype: type = np.float64) -> NDArray:
    """Return a read-only copy of shape (40,), or the values themselves if nobody can write to them any more.

    `ValueError` names the field and the shape it got.
    """
    if isinstance(values, np.ndarray) and _is_final(values) and values.dtype == dtype and values.shape == (LAYOUT.dof,):
        return values
    array = np.array(values, dtype=dtype)
    if array.shape != (LAYOUT.dof,):
        raise ValueError(f"{name}: got shape {array.shape}, allowed is ({LAYOUT.dof},)")
    array.setflags(write=False)
    return array


def _is_final(array: NDArray) -> bool:
    """Tell whether an array, and the one that it looks into, are read-only."""
    owner = array.base
    return not array.flags.writeable and (
        owner is None or (type(owner) is np.ndarray and owner.base is None and not owner.flags.writeable)
    )


@dataclass(frozen=True, slots=True, eq=False)
class RobotState:
    """One sample of all 40 joints, in layout order.

    position rad, velocity rad/s, torque N m at the link-side sensor; `stamp_ns` is when each joint was
    sampled on the reader's clock, so `now - stamp_ns` is a sample's age. `sequence` echoes the last
    command the device has taken.
    """

    sequence: int
    position: Vector
    velocity: Vector
    torque: Vector
    stamp_ns: NDArray[np.int64]
    status: DeviceStatus = DeviceStatus.DISARMED
    fault: str = ""

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "torque"):
            object.__setattr__(self, name, read_only(getattr(self, name), name))
        object.__setattr__(self, "stamp_ns", read_only(self.stamp_ns, "stamp_ns", np.int64))

    def age_ns(self, now_ns: int) -> NDArray[np.int64]:
        """Return each joint's sample age at `now_ns`."""
        return now_ns - self.stamp_ns


@dataclass(frozen=True, slots=True, eq=False)
class RobotCommand:
    """One command to all 40 joints: positions (rad), each with the torque (N m) it may use at most.

    In Mode.TORQUE `position` is ignored and `torque` is the target, still clipped at `torque_limit`.
    """

    sequence: int
    mode: Mode
    position: Vector
    torque_limit: Vector
    torque: Vector = field(default_factory=lambda: np.zeros(LAYOUT.dof))

    def __post_init__(self) -> None:
        for name in ("position", "torque_limit", "torque"):
            object.__setattr__(self, name, read_only(getattr(self, name), name))
