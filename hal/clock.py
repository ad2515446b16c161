"""Time as the loop sees it: read once a tick and passed in; nothing else reads a clock."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A monotonic clock in nanoseconds that can be waited on."""

    def now_ns(self) -> int:
        """Return the current time."""
        ...

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Return at or after the deadline, at once when it has passed."""
        ...


class MonotonicClock:
    """The machine's monotonic clock, or one that goes at another pace; at one pace it is the same in every process."""

    def __init__(self, pace: float = 1.0) -> None:
        """Go by so many seconds in each of the machine's; `ValueError` for a pace that is not above 0."""
        if not pace > 0.0:
            raise ValueError(f"pace: got {pace}, allowed is > 0")
        self.pace = pace

    def now_ns(self) -> int:
        """Return the machine's monotonic time, times the pace."""
        return time.monotonic_ns() if self.pace == 1.0 else round(time.monotonic_ns() * self.pace)

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Sleep until the deadline."""
        remaining = deadline_ns - self.now_ns()
        if remaining > 0:
            time.sleep(remaining * 1e-9 / self.pace)
