"""Sliding of the box in the holding hand, and quantities that must last to count."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.hal.compiled import compiled
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.sim_backend.contact_scan import LINKS

DEADBAND_M = 0.0002
"""Sliding back and forth by less than this is the contact's own give, not slip, m."""
LOAD_FILTER_S = 0.02


class HoldSlip:
    """Sliding accumulated at the contacts of the holding hand.

    Each hand part integrates its tangential velocity against the box, s = int v_t dt (vector, box frame). Whenever
    s has moved by the dead band the distance is added to the part's path, and, weighted by the part's share of the
    load of all that holds (low-passed), to its hand's slip: a hand that only touches on leaving adds little.
    """

    def __init__(self, timestep_s: float) -> None:
        """Start with no slip; `update` is called every `timestep_s`."""
        self._dt = timestep_s
        self._keep = float(np.exp(-timestep_s / LOAD_FILTER_S))
        self.load = np.zeros(LINKS)
        self.path_m = np.zeros(LINKS)
        """Sliding path of each hand part while its hand held, m."""
        self._net, self._anchor = np.zeros((LINKS, 3)), np.zeros((LINKS, 3))
        self.hand_slip_m = np.zeros(2)
        """Slip in the right and in the left hand, m."""

    def update(self, link_load: Vector, link_slide: Matrix, right_holds: bool, left_holds: bool) -> None:
        """Take one step's loads (36,) and sliding velocities (36, 3)."""
        _slide(
            link_load, link_slide, self._dt, self._keep, right_holds, left_holds,
            self.load, self._net, self._anchor, self.path_m, self.hand_slip_m,
        )  # fmt: skip

    @property
    def slip_m(self) -> float:
        """The slip of the hand in which the box slid more, m."""
        return float(self.hand_slip_m.max())

    def grip_load(self) -> tuple[float, float]:
        """Return the filtered sum of normal forces of the right and of the left hand on the box, N."""
        right, left = self.load.reshape(2, -1).sum(axis=1)
        return float(right), float(left)


@compiled
def _slide(
    load: Vector, slide: Matrix, dt: float, keep: float, right_holds: bool, left_holds: bool,
    filtered: Vector, net: Matrix, anchor: Matrix, path: Vector, slip: Vector,
) -> None:  # fmt: skip
    half = len(load) // 2
    total = 0.0
    for link in range(len(load)):
        filtered[link] = keep * filtered[link] + (1.0 - keep) * load[link]
        if (right_holds and link < half) or (left_holds and link >= half):
            total += filtered[link]
    for link in range(len(load)):
        hand = link // half
        holds = right_holds if hand == 0 else left_holds
        if not holds:
            anchor[link] = net[link]
            continue
        if load[link] <= 0.0:
            continue
        distance = 0.0
        for k in range(3):
            net[link, k] += dt * slide[link, k]
            distance += (net[link, k] - anchor[link, k]) ** 2
        distance = np.sqrt(distance)
        if distance > DEADBAND_M:
            anchor[link] = net[link]
            path[link] += distance
            slip[hand] += distance * filtered[link] / total if total > 0.0 else 0.0


class Sustained:
    """The largest size of each channel that lasted for a number of steps: max over time of a sliding minimum."""

    def __init__(self, units: Vector, steps: int) -> None:
        """Watch |value| / unit of some channels, by their units; it counts when it has lasted `steps` steps."""
        channels = len(units)
        self._units = units
        self._ring: NDArray[np.float64] = np.zeros((steps, channels))
        self._slot = 0
        self.worst = np.zeros(channels)
        self.peak = np.zeros(channels)
        """Largest single size of each channel."""

    def update(self, values: Vector) -> None:
        """Take one step's values (channels,)."""
        _last(self._ring, self._slot, values, self._units, self.worst, self.peak)
        self._slot = (self._slot + 1) % len(self._ring)


@compiled
def _last(ring: Matrix, slot: int, values: Vector, units: Vector, worst: Vector, peak: Vector) -> None:
    for i in range(len(values)):
        size = abs(values[i]) / units[i]
        ring[slot, i] = least = size
        for row in range(len(ring)):
            least = min(least, ring[row, i])
        worst[i] = max(worst[i], least)
        peak[i] = max(peak[i], size)
