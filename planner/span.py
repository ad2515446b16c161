"""How wide a hand can open between thumb and fingers: what is wider no hand can grasp (section III-C)."""

from __future__ import annotations

from functools import cache

import numpy as np

from preshape.planner.finger_count import EDGE, SPACING, fingers_for
from preshape.planner.postures import STRAIGHT
from preshape.planner.preshape_qp import STANDOFF, PreshapeProblem, solve
from preshape.planner.preshaping_box import FINGER_REACH, PreshapingBox

GAP_TOLERANCE = 0.5e-3
"""To what the widest gap is found, m."""

GAP_LIMIT = 0.40
"""Wider than any hand, m."""


@cache
def widest_gap(
    fingers: tuple[str, ...],
    depth: float = FINGER_REACH,
    standoff_m: tuple[float, float] = STANDOFF,
    tilt_max_rad: float = 0.6,
) -> float:
    """Return the widest preshaping box (edge along x, m) that these fingers reach, by bisection on the preshape QP.

    Both hands are mirror images and open equally wide. `depth`, `standoff_m` and `tilt_max_rad` are the palm's
    conditions of `PreshapeProblem`; 0.0 when not even 10 mm can be spanned.
    """

    def reached(gap: float) -> bool:
        half = np.array([gap / 2.0, EDGE + (len(fingers) - 1) * SPACING / 2.0, depth])
        problem = PreshapeProblem(
            "right", np.eye(4), half, STRAIGHT, fingers, standoff_m=standoff_m, tilt_max_rad=tilt_max_rad
        )
        return solve(problem).reached

    # The ring meets the thumb only across a wide gap, so the search goes up from where all grasps exist.
    low = next((gap for gap in (0.10, 0.08, 0.06, 0.03, 0.01) if reached(gap)), None)
    if low is None:
        return 0.0
    high = GAP_LIMIT
    while high - low > GAP_TOLERANCE:
        middle = (low + high) / 2.0
        low, high = (middle, high) if reached(middle) else (low, middle)
    return low


def can_span(box: PreshapingBox, fingers: tuple[str, ...] = ()) -> bool:
    """Return whether a hand opens wide enough for a preshaping box."""
    return 2.0 * float(box.half[0]) <= widest_gap(tuple(fingers) or fingers_for(box.half), box.depth)
