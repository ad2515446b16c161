"""A hand whose grasp has missed or slipped opens, and leaves the way it came."""

from __future__ import annotations

import numpy as np

from preshape.control.motions import Motion, lead_palm
from preshape.control.work import Work
from preshape.hal.layout import Side
from preshape.hal.transform import transform
from preshape.planner.availability import PREGRASP_M

AWAY_SPEED = 0.05
"""Peak speed of a hand that leaves what it does not hold, m/s."""


def let_go(work: Work, side: Side) -> Motion:
    """Open a hand and draw it back against the direction in which its grip's hand comes.

    Where the box is now is not asked: the estimate may just have told that it is not where the hand has closed.
    """
    work.phase = "let go"
    yield from work.hands[side].open()
    if work.sight.held_by == side:
        work.sight.release()
    grip = work.grips.get(side)
    advance = np.array([0.0, 0.0, 1.0]) if grip is None else grip.advance
    X_back = work.body.asked_palm(side) @ transform(-PREGRASP_M * advance)
    yield from lead_palm(work.body, side, X_back, speed=AWAY_SPEED)
