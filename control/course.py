"""A hand motion in the opening's frame together with the arm postures that carry it out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from preshape.control.aim import Aim, tips_of
from preshape.control.motions import Motion, between, eased, ticks
from preshape.control.opening_motion import HandWaypoint
from preshape.control.work import Work
from preshape.hal.layout import LAYOUT, Side, finger_slice
from preshape.hal.sah_hand import FOREFINGERS
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, inverse, log_so3
from preshape.planner.arm_chain import ChainQuery, posture_chain

TURN_RAD = 0.18
"""Legs that turn the hand by more than this get postures in between, rad."""
SPEED_SHARE = 0.35
"""Share of the joint speed limits that a leg may use."""
_FINGERS = np.r_[tuple(finger_slice(finger) for finger in FOREFINGERS)]
HURRY = 4.0
"""How much faster than usual the arm drifts to the course's postures."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Way-points, and for each leg the arm postures (k, 7), rad, that it leads through; the first leg has one."""

    waypoints: tuple[HandWaypoint, ...]
    legs: tuple[Matrix, ...]

    @property
    def start(self) -> Vector:
        """The posture (7) at the first way-point."""
        return self.legs[0][-1]


def plan_course(
    work: Work,
    side: Side,
    X_world_opening: Matrix,
    waypoints: Sequence[HandWaypoint],
    is_free: Callable[[int, Vector], bool],
    query: ChainQuery | None = None,
) -> Course | None:
    """Return a course for an opening at a pose, or None where the arm cannot follow; `is_free(way-point, q)`."""
    poses: list[Matrix] = [X_world_opening @ waypoints[0].X_opening_palm]
    legs: list[int] = [0]
    for number, waypoint in enumerate(waypoints[1:], start=1):
        X_from, X_to = poses[-1], X_world_opening @ waypoint.X_opening_palm
        parts = max(1, int(np.ceil(np.linalg.norm(log_so3(X_from[:3, :3].T @ X_to[:3, :3])) / TURN_RAD)))
        poses += [between(X_from, X_to, (k + 1) / parts) for k in range(parts)]
        legs += [number] * parts
    chain = posture_chain(
        side, work.cell.X_world_base[side], np.array(poses), is_free=lambda k, q: is_free(legs[k], q), query=query
    )
    if chain is None:
        return None
    number_of = np.array(legs)
    return Course(tuple(waypoints), tuple(chain[number_of == k] for k in range(len(waypoints))))


def follow_course(work: Work, side: Side, X_world_opening: Matrix, course: Course) -> Motion:
    """Lead a hand through a course whose first way-point it has reached; aimed once, before anything is touched.

    Aiming anew while the hand presses would follow the box as it gives way, and push it out of the other hand.
    """
    body = work.body
    q_last = course.start
    for waypoint, postures in zip(course.waypoints, course.legs, strict=True):
        work.phase = waypoint.name
        X_start, X_goal = body.asked_palm(side).copy(), X_world_opening @ waypoint.X_opening_palm
        body.aims[side] = Aim(tips_of(side, inverse(work.sight.X_world_box) @ X_goal, waypoint.fingers))
        q_start = body.asked_fingers(side)
        limit = LAYOUT.torque[LAYOUT.hand(side)].copy()
        limit[_FINGERS] = np.minimum(limit[_FINGERS], waypoint.finger_torque)
        knots = np.vstack([q_last, postures])
        count = ticks(body, max(waypoint.duration_s, _least_seconds(side, knots)))
        for k in range(1, count + 1):
            u = eased(k / count)
            body.ask_palm(side, between(X_start, X_goal, u))
            body.prefer_posture(side, _at(knots, u), HURRY)
            body.ask_fingers(side, q_start + u * (waypoint.fingers - q_start), limit)
            yield
        q_last = postures[-1]
    del body.aims[side]


def _least_seconds(side: Side, knots: Matrix) -> float:
    """Return how long an eased leg through postures (k, 7) must take to keep within a share of the speed limits."""
    share = np.abs(np.diff(knots, axis=0)) / LAYOUT.velocity[LAYOUT.arm(side)]
    return 15.0 / 8.0 * float(share.max()) * (len(knots) - 1) / SPEED_SHARE


def _at(knots: Matrix, u: float) -> Vector:
    """Return the posture a share u of the way through equally spaced knots (k, 7)."""
    place = u * (len(knots) - 1)
    k = min(int(place), len(knots) - 2)
    return knots[k] + (place - k) * (knots[k + 1] - knots[k])
