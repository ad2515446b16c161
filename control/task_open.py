"""Tasks 4 and 5: the right thumb pushes the opening area in; then the lid is torn and opened."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from preshape.control.motions import Motion, between, eased, ticks
from preshape.control.opening_frame import opening_frame
from preshape.control.opening_motion import HandWaypoint
from preshape.control.work import Work
from preshape.hal.layout import LAYOUT
from preshape.hal.transform import Matrix
from preshape.hal.world import Opening

TORQUE_GAIN = 4.0
"""Finger speed per missing torque, rad/s/(N m)."""
TORQUE_SPEED = 0.8
"""Largest finger speed of the torque law, rad/s."""


def opening_in_world(work: Work, opening: Opening) -> Matrix:
    """Return X_world_opening by the present estimate of the box."""
    return work.sight.X_world_box @ opening_frame(work.box, opening)


def enter(work: Work, opening: Opening, first: HandWaypoint, speed: float = 0.3) -> Motion:
    """Bring the right arm on a free path to a motion's first way-point."""
    X = opening_in_world(work, opening) @ first.X_opening_palm
    work.body.ask_fingers("right", first.fingers)
    yield from work.travel_to_palm("right", X, speed)


def play(work: Work, opening: Opening, waypoints: Sequence[HandWaypoint]) -> Motion:
    """Lead the right hand through way-points given in the opening's frame, each aimed anew when it begins."""
    body = work.body
    for waypoint in waypoints:
        work.phase = waypoint.name
        X_start = body.asked_palm("right").copy()
        X_goal = opening_in_world(work, opening) @ waypoint.X_opening_palm
        q_start = body.asked_fingers("right")
        q = q_start.copy()
        driven = np.zeros(len(q), bool) if waypoint.torque_goal is None else np.isfinite(waypoint.torque_goal)
        count = ticks(body, waypoint.duration_s)
        for k in range(1, count + 1):
            u = eased(k / count)
            body.ask_palm("right", between(X_start, X_goal, u))
            placed = q_start + u * (waypoint.fingers - q_start)
            if waypoint.torque_goal is not None:
                missing = waypoint.torque_goal - body.torque[LAYOUT.hand("right")]
                speed = np.clip(TORQUE_GAIN * missing, -TORQUE_SPEED, TORQUE_SPEED)
                q = np.where(driven, q + body.period_s * speed, placed)
            else:
                q = placed
            lower, upper = work.limits("right")
            q = np.clip(q, lower, upper)
            body.ask_fingers("right", q)
            yield
