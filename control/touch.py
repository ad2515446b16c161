"""Touch from joint torque: a residual that lasts; and sensors that no longer say anything."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.hal.compiled import compiled
from preshape.hal.layout import HAND_DOF
from preshape.hal.state import Vector

Flags = NDArray[np.bool_]

TOUCH_NM = 0.08
"""Residual above which a joint has met something, N m."""
TOUCH_TICKS = 6
"""How many ticks in a row the residual must last."""
BIAS_TICKS = 10
"""Ticks after `reset` over which the free torque is averaged."""
FROZEN_TICKS = 100
"""A noisy sensor whose value has not changed for so many ticks is dead."""


class TouchSense:
    """Debounced touch of each of a hand's 13 joints, against the torque measured before closing."""

    def __init__(self) -> None:
        """Start untouched."""
        self.touching: Flags = np.zeros(HAND_DOF, dtype=np.bool_)
        self.frozen: Flags = np.zeros(HAND_DOF, dtype=np.bool_)
        self._bias = np.zeros(HAND_DOF)
        self._samples = 0
        self._over = np.zeros(HAND_DOF, dtype=np.int64)
        self._same = np.zeros(HAND_DOF, dtype=np.int64)
        self._last = np.full(HAND_DOF, np.nan)

    def reset(self) -> None:
        """Forget touches and take the free torque anew."""
        self._samples = 0
        self._bias[:] = 0.0
        self._over[:] = 0
        self.touching[:] = False

    def update(self, torque: Vector) -> None:
        """Take this tick's joint torques (13), N m."""
        count_same(torque, self._last, self._same, self.frozen)
        if self._samples < BIAS_TICKS:
            self._samples += 1
            self._bias += (torque - self._bias) / self._samples
            return
        count_over(torque, self._bias, TOUCH_NM, TOUCH_TICKS, self._over, self.touching)


@compiled
def count_same(torque: Vector, last: Vector, same: NDArray[np.int64], frozen: Flags) -> None:
    """Count in place for how many ticks each torque has been the same, and mark those that are dead."""
    for j in range(len(torque)):
        same[j] = same[j] + 1 if torque[j] == last[j] else 0
        last[j] = torque[j]
        frozen[j] = same[j] >= FROZEN_TICKS


@compiled
def count_over(value: Vector, free: Vector, most: float, ticks: int, over: NDArray[np.int64], touching: Flags) -> None:
    """Count in place for how many ticks each value has been further than `most` from what it is when free; mark."""
    for j in range(len(value)):
        over[j] = over[j] + 1 if abs(value[j] - free[j]) > most else 0
        touching[j] = touching[j] or over[j] >= ticks
