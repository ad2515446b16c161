"""What the rules of the wire share: how one is broken, and which positions have been reported of late. Pure."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from preshape.hal.state import Vector

STOP_CYCLES, STOP_S = 5, 0.010
"""After a quick stop nothing is armed, and no motion is commanded, later than so many periods and this time, s.
So it is after the last command."""
REPORT_CYCLES = 10
"""The first target equals a position that was reported within so many periods before it."""


def stop_limit_s(period_s: float, cycles: int = STOP_CYCLES) -> float:
    """Return how long after a quick stop something may still move, when commands come every period, s."""
    return cycles * period_s + STOP_S


@dataclass(frozen=True, slots=True)
class Violation:
    """A rule that was broken: when (s), which, by whom, and how."""

    time_s: float
    rule: str
    owner: str
    text: str

    def __str__(self) -> str:
        return f"{self.rule}: {self.owner}: {self.text} at {self.time_s:.4f} s"


class Positions:
    """What has been reported of every joint of late: the only positions that a first command may have."""

    def __init__(self, period_s: float) -> None:
        """Expect reports every period."""
        self._window_s = REPORT_CYCLES * period_s
        self._reported: deque[tuple[float, NDArray[np.int64], Vector]] = deque()

    def add(self, time_s: float, indices: NDArray[np.int64], position: Vector) -> None:
        """Take a module's positions (n,), of the joints with these places in the layout."""
        self._reported.append((time_s, indices, position))
        while self._reported[0][0] < time_s - self._window_s:
            self._reported.popleft()

    def nearest_error(self, time_s: float, index: int, target: float) -> float:
        """Return how far a target is from the nearest position reported of a joint of late; infinite: none was."""
        errors = [
            abs(target - float(position[list(indices).index(index)]))
            for reported_s, indices, position in self._reported
            if index in indices and time_s - reported_s <= self._window_s
        ]
        return min(errors, default=np.inf)
