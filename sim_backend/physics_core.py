"""Which core physics in real time has to itself, apart from the loops that drive it."""

from __future__ import annotations

from collections.abc import Set


def physics_core(cores: Set[int]) -> int | None:
    """Return the one of these cores that physics keeps to and loops keep off, None if there is only one.

    A kernel keeps from running what has taken 95 % of a core for a second by real-time priority. Physics and a loop
    that come to share one core take that much together, and stood still for up to 50 ms.
    """
    return max(cores) if len(cores) > 1 else None
