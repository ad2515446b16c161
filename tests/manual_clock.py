"""A clock that only moves when it is told to, and takes a simulation with it."""

from __future__ import annotations

from collections.abc import Callable


class ManualClock:
    """Time starts at a second and moves by `sleep_until_ns`; `advance` is told of every move, in order."""

    def __init__(self, advance: Callable[[int], None] | None = None) -> None:
        self._now_ns = 1_000_000_000
        self._advance = advance

    def now_ns(self) -> int:
        """Return the current time."""
        return self._now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Move to the deadline, never back."""
        if deadline_ns > self._now_ns:
            self._now_ns = deadline_ns
            if self._advance is not None:
                self._advance(self._now_ns)
