"""A clock on which whoever waits can be made to wake up late: a host whose process stands still for a while."""

from __future__ import annotations

from preshape.hal.clock import Clock


class StallingClock:
    """`preshape.hal.clock.Clock` that passes everything on to another; `stall` lengthens the next wait."""

    def __init__(self, clock: Clock) -> None:
        """Take the time from another clock."""
        self._clock = clock
        self._stall_ns = 0

    def stall(self, seconds: float) -> None:
        """Let the next wait end so much later."""
        self._stall_ns += round(seconds * 1e9)

    def now_ns(self) -> int:
        """Return the other clock's time."""
        return self._clock.now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Wait on the other clock, until the deadline or, in a stall, as much later."""
        late_ns, self._stall_ns = self._stall_ns, 0
        self._clock.sleep_until_ns(max(deadline_ns, self._clock.now_ns()) + late_ns if late_ns else deadline_ns)
