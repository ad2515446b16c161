"""A hand motion in the opening's frame together with the arm postures that carry it out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from preshape.control.aim import Aim, tips_of
from preshape.control.approach import FieldGuide
from preshape.control.contact_policy import Contact, Phase, members_that
from preshape.control.deflection import Deflection
from preshape.control.failure import TaskFailed
from preshape.control.field import HandGoal
from preshape.control.groups import MEMBERS
from preshape.control.hand_touch import HandTouch
from preshape.control.motions import Motion, between, eased, ticks
from preshape.control.obstacles import Kind
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


def follow_course(work: Work, guide: FieldGuide, side: Side, X_world_opening: Matrix, course: Course) -> Motion:
    """Lead a hand through a course whose first way-point it has reached; aimed once, before anything is touched.

    Aiming anew while the hand presses would follow the box as it gives way, and push it out of the other hand. The
    field takes the hand off its way as the contact policy says. `TaskFailed` if no finger has met the opening on the
    second leg on which one must.
    """
    led = _Led(work, guide, side, X_world_opening)
    q_last, missed = course.start, False
    for waypoint, postures in zip(course.waypoints, course.legs, strict=True):
        work.phase = waypoint.name
        if waypoint.free:
            led.touch.forget()
        fingers = waypoint.opened if missed and waypoint.opened is not None else waypoint.fingers
        yield from led.leg(waypoint, fingers, np.vstack([q_last, postures]))
        if waypoint.meets and missed:
            led.touch.forget()
            yield from led.leg(waypoint, waypoint.fingers, postures[[-1, -1]])
            if not led.pinches():
                raise TaskFailed("missed: no finger has met the opening from outside")
            missed = False
        elif waypoint.meets and not led.pinches():
            work.notes.append(f"{waypoint.name}: no finger has met the opening from outside; tried again further on")
            missed = True
        q_last = postures[-1]
    del work.body.aims[side]


class _Led:
    """A hand on its course: the given motion, the field's deflection, and what the fingers have met."""

    def __init__(self, work: Work, guide: FieldGuide, side: Side, X_world_opening: Matrix) -> None:
        self._body, self._sight, self._deflection = work.body, work.sight, Deflection(guide, work.body, side)
        self._side: Side = side
        self._X_world_opening, self._X_opening_world = X_world_opening, inverse(X_world_opening)
        self._X, self._q = work.body.asked_palm(side).copy(), work.body.asked_fingers(side)
        self.touch = HandTouch(side, work.body)

    def leg(self, waypoint: HandWaypoint, fingers: Vector, knots: Matrix) -> Motion:
        """Lead palm and fingers to the end of a leg, through arm postures (k, 7), rad."""
        body, side = self._body, self._side
        X_start, q_start = self._X, self._q
        X_goal = self._X_world_opening @ waypoint.X_opening_palm
        body.aims[side] = Aim(tips_of(side, inverse(self._sight.X_world_box) @ X_goal, fingers))
        limit = LAYOUT.torque[LAYOUT.hand(side)].copy()
        limit[_FINGERS] = np.minimum(limit[_FINGERS], waypoint.finger_torque)
        self._deflection.head_for(HandGoal(X_goal, fingers))
        count = ticks(body, max(waypoint.duration_s, _least_seconds(side, knots)))
        for k in range(1, count + 1):
            u = eased(k / count)
            self._X, self._q = between(X_start, X_goal, u), q_start + u * (fingers - q_start)
            self.touch.update()
            asked = self._deflection.applied(HandGoal(self._X, self._q), self._phase(waypoint.phase))
            body.ask_palm(side, asked.X_world_palm)
            body.prefer_posture(side, _at(knots, u), HURRY)
            body.ask_fingers(side, asked.joints, limit)
            yield

    def _phase(self, phase: Phase) -> Phase:
        """Return the policy's phase: before contact only until the thumb has met the opening, or is in it."""
        if phase is Phase.BEFORE_CONTACT and (self.touch.met("thumb") or self._is_inside()):
            return Phase.AFTER_CONTACT
        return phase

    def _is_inside(self) -> bool:
        body, side = self._body, self._side
        tip = tips_of(side, body.palm(side), body.position[LAYOUT.hand(side)])[0]
        return float(self._X_opening_world[2, :3] @ tip + self._X_opening_world[2, 3]) < 0.0

    def pinches(self) -> bool:
        """Whether the thumb from within and a finger from without have met the opening, or would not be felt to."""
        must = members_that(Contact.MUST, Phase.PINCH, Kind.OPENING, frozenset(MEMBERS))
        may_have = {member for member in must if self.touch.met(member) or self.touch.blind(member)}
        return "thumb" in may_have and len(may_have) > 1


def _least_seconds(side: Side, knots: Matrix) -> float:
    """Return how long an eased leg through postures (k, 7) must take to keep within a share of the speed limits."""
    share = np.abs(np.diff(knots, axis=0)) / LAYOUT.velocity[LAYOUT.arm(side)]
    return 15.0 / 8.0 * float(share.max()) * (len(knots) - 1) / SPEED_SHARE


def _at(knots: Matrix, u: float) -> Vector:
    """Return the posture a share u of the way through equally spaced knots (k, 7)."""
    place = u * (len(knots) - 1)
    k = min(int(place), len(knots) - 2)
    return knots[k] + (place - k) * (knots[k + 1] - knots[k])
