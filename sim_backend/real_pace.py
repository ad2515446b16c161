"""A simulation held to the machine's clock: it waits for its time, and stands still when the machine was late."""

from __future__ import annotations

import time

from preshape.hal.clock import MonotonicClock
from preshape.sim_backend.simulation import STEP_NS

SLIP_NS = 3_000_000
"""Lateness from which on the scene stands still for that time instead of catching up in a burst, ns."""
YIELD_S = 6e-5
"""How long a scene that is late leaves the processor to others in each step, s: a kernel keeps from running for up to
50 ms what has taken 95 % of a core for a second by real-time priority."""


class RealPace:
    """`offset_ns` is the clock's time less the scene's; `slipped_ns` for how long the scene stood still."""

    def __init__(self, pace: float = 1.0) -> None:
        """Let so many seconds of the scene pass in each of the machine's."""
        self._clock = MonotonicClock(pace)
        self.offset_ns = 0
        self.slipped_ns = self.slips = 0

    def begin(self, scene_ns: int) -> None:
        """Let the scene's present time be now."""
        self.offset_ns = self._clock.now_ns() - scene_ns

    def wait(self, scene_ns: int) -> None:
        """Sleep until the step after `scene_ns` is due; after a stall of the machine let the scene stand still."""
        due_ns = self.offset_ns + scene_ns + STEP_NS
        remaining_ns = due_ns - self._clock.now_ns()
        if remaining_ns > 0:
            self._clock.sleep_until_ns(due_ns)
            return
        if remaining_ns < -SLIP_NS:
            self.offset_ns -= remaining_ns
            self.slipped_ns -= remaining_ns
            self.slips += 1
        time.sleep(YIELD_S)
