"""Torque sensors that no longer say anything, of all joints, by name: for the report, and for whoever asks."""

from __future__ import annotations

import numpy as np

from preshape.control.touch import Flags, count_same
from preshape.hal.layout import LAYOUT
from preshape.hal.state import Vector


class SensorWatch:
    """Tells a sensor that is dead from one that measures little: a live one is noisy; `update` once a tick."""

    def __init__(self) -> None:
        """Start with every sensor alive."""
        self.frozen: Flags = np.zeros(LAYOUT.dof, dtype=np.bool_)
        self._same = np.zeros(LAYOUT.dof, dtype=np.int64)
        self._last = np.full(LAYOUT.dof, np.nan)
        self._named: set[int] = set()

    def update(self, torque: Vector) -> tuple[str, ...]:
        """Take this tick's torques (40,), N m; return the names of joints found frozen for the first time."""
        count_same(torque, self._last, self._same, self.frozen)
        if not self.frozen.any():
            return ()
        fresh = [joint for joint in np.flatnonzero(self.frozen).tolist() if joint not in self._named]
        self._named.update(fresh)
        return tuple(LAYOUT.names[joint] for joint in fresh)
