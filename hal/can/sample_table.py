"""The newest measurements of every module, kept as they came and scaled once for all joints when they are read."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from preshape.hal.can.topology import Topology
from preshape.hal.layout import LAYOUT
from preshape.hal.state import Vector

NEVER_NS = -(1 << 60)
"""Stamp of a joint that has not been heard of: older than anything."""


class SampleTable:
    """Rows are modules, in the topology's order; joints on no module stay at NaN and `NEVER_NS`."""

    def __init__(self, topology: Topology) -> None:
        modules = [(group, module) for group in topology.groups for module in group.modules]
        self._rows: list[Sequence[float]] = [(np.nan,) * (3 * len(module.joints)) for _, module in modules]
        self._sent_ns = [NEVER_NS] * (len(modules) + 1)
        entries = sum(3 * len(module.joints) for _, module in modules)
        # One entry more, always NaN, and one row more, always NEVER_NS, for joints that are nowhere.
        self._place = np.full((3, LAYOUT.dof), entries, dtype=np.int64)
        self._scale = np.ones((3, LAYOUT.dof))
        self._owner = np.full(LAYOUT.dof, len(modules), dtype=np.int64)
        at = 0
        for row, (group, module) in enumerate(modules):
            joints, count = list(module.indices), len(module.joints)
            units = (group.scale.position, group.scale.velocity, group.scale.torque)
            for quantity, unit in enumerate(units):
                self._place[quantity, joints] = np.arange(at, at + count)
                self._scale[quantity, joints] = unit
                at += count
            self._owner[joints] = row

    def put(self, row: int, counts: Sequence[float], sent_ns: int) -> None:
        """Keep a module's counts (3 n,) (positions, velocities, torques) and when their request was sent."""
        self._rows[row] = counts
        self._sent_ns[row] = sent_ns

    def values(self) -> Vector:
        """Return positions (rad), velocities (rad/s) and torques (N m) of all joints (3, 40), new and read-only."""
        flat = np.array([*chain.from_iterable(self._rows), np.nan])
        values = flat[self._place]
        values *= self._scale
        values.setflags(write=False)
        return values

    def stamps(self) -> NDArray[np.int64]:
        """Return when the request that each joint's sample answers was sent (40,), ns, new and read-only."""
        stamps = np.array(self._sent_ns, dtype=np.int64)[self._owner]
        stamps.setflags(write=False)
        return stamps
