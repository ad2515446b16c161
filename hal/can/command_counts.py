"""Targets and torque limits of many joints as the integers that commands carry: one pass for all groups of a robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.can.scales import Scale
from preshape.hal.state import Vector

_ROUNDING = 1e-6
"""A limit within this part of a count below a whole one is that whole one, not one less."""
_UNSIGNED_MOST = (1 << 16) - 1


class CommandCounts:
    """Turns targets and limits of n joints into counts, group by group: a group's targets, then its limits.

    A target becomes floor(value / scale + 1/2), a limit floor(value / scale + 1e-6): no more torque than asked for.
    What no count can say becomes the nearest that can; no limit exceeds the joint's own, if those are given.
    """

    def __init__(
        self, groups: Sequence[tuple[ArrayLike, Scale]], joints: int, most_torque: Vector | None = None
    ) -> None:
        """Take each group's places among the `joints` of the vectors to come, its scale, and limits of torque (n,)."""
        order: list[int] = []
        scale: list[float] = []
        half: list[float] = []
        least: list[float] = []
        most: list[float] = []
        for places, unit in groups:
            indices = np.asarray(places, dtype=np.int64).tolist()
            count, reach = len(indices), 2.0 ** (unit.position_bits - 1)
            order += [*indices, *(index + joints for index in indices)]
            scale += [unit.position] * count + [unit.torque] * count
            half += [0.5] * count + [_ROUNDING] * count
            least += [-reach] * count + [0.0] * count
            most += [reach - 1.0] * count
            most += _most_limits(count if most_torque is None else most_torque[indices], unit)
        self.scale = np.array(scale)
        """Units of one count, in the order of the counts."""
        self._order = np.array(order, dtype=np.int64)
        self._per_unit, self._half = 1.0 / self.scale, np.array(half)
        self._least, self._most = np.array(least), np.array(most)
        self._both = np.empty(2 * joints)
        self._work = np.empty(len(order))
        self._joints = joints

    def of(self, target: Vector, torque_limit: Vector) -> list[int]:
        """Return the counts of targets (rad, or N m in torque mode) and limits (N m), each (n,) and finite."""
        both, work = self._both, self._work
        both[: self._joints], both[self._joints :] = target, torque_limit
        # "clip" only spares numpy a buffer: the order is within bounds.
        np.take(both, self._order, out=work, mode="clip")
        np.multiply(work, self._per_unit, out=work)
        np.add(work, self._half, out=work)
        np.floor(work, out=work)
        np.maximum(work, self._least, out=work)
        np.minimum(work, self._most, out=work)
        return work.astype(np.int64).tolist()


def _most_limits(torque: Vector | int, unit: Scale) -> list[float]:
    """Return the largest counts of torque limits: those of given torques (n,), N m, or what the width allows."""
    if isinstance(torque, int):
        return [float(_UNSIGNED_MOST)] * torque
    return np.minimum(np.floor(torque / unit.torque + _ROUNDING), _UNSIGNED_MOST).tolist()
