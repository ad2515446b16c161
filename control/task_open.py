"""Tasks 4 and 5: the left hand presents the box; the right thumb pushes the opening area in and opens the lid."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace

import numpy as np

from preshape.control.approach import FieldGuide
from preshape.control.course import Course, follow_course, plan_course
from preshape.control.failure import TaskFailed
from preshape.control.motions import Motion, lead_fingers
from preshape.control.opening_frame import opening_frame
from preshape.control.opening_motion import HandWaypoint
from preshape.control.work import CLEARANCE_M, CLOSE_ROOM_M, Work
from preshape.hal.layout import ARM_DOF, SIDES, Side
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, inverse
from preshape.hal.world import Face, Opening
from preshape.planner.air_pose import ELSEWHERE, AirPlace, air_pose, open_places
from preshape.planner.arm_capsules import HeldBox
from preshape.planner.arm_chain import ChainQuery
from preshape.planner.arm_collision import ArmCollision

ROOMY = ChainQuery(least_score=10.0)
"""What a place must offer the right arm; the motion itself may then come nearer to a limit."""
NARROW = ChainQuery(least_score=6.0)
"""What it must offer where obstacles leave no roomy one."""
PRESENT_SPEED = 0.15
"""Share of the joint speed limits with which the left arm presents the box: a box that is turned fast slides."""


class _Checker:
    """Whether the right arm may stand at a way-point: only its hand may come near the box."""

    def __init__(self, work: Work, held: HeldBox, q_left: Vector) -> None:
        exempt = (("right_hand", "held"), ("right_hand", "left_hand"), *work.at_rest("right"))
        q_hands: dict[Side, Vector] = {side: work.body.asked_fingers(side) for side in SIDES}
        self._model = ArmCollision(work.cell, q_hands, held, (), exempt, tuple(work.sight.obstacles))
        self._q = np.concatenate([np.zeros(ARM_DOF), q_left])

    def __call__(self, number: int, q: Vector) -> bool:
        self._q[:ARM_DOF] = q
        return self._model.is_free(self._q, CLEARANCE_M / 2, CLOSE_ROOM_M)


def present(
    work: Work, opening: Opening, right_end: Face, motions: Sequence[Sequence[HandWaypoint]]
) -> Generator[None, None, tuple[Course, ...]]:
    """Bring the box, held by the left hand, to the first place where the right arm can follow all motions.

    Returns the right arm's courses through them.
    """
    work.phase = "present"
    held = HeldBox("left", inverse(work.body.palm("left")) @ work.sight.X_world_box, work.box.size / 2)
    X_box_palm, X_box_opening = inverse(held.X_palm_box), opening_frame(work.box, opening)
    for place, query in _places(work):
        X_box = air_pose(place, right_end, opening.face)
        q_left = work.posture("left", X_box @ X_box_palm, work.collision(work.at_rest("left"), held))
        if q_left is None:
            continue
        courses = _courses(work, X_box @ X_box_opening, motions, _Checker(work, held, q_left), query)
        if courses is None:
            continue
        try:
            yield from work.travel("left", q_left, PRESENT_SPEED)
            return courses
        except TaskFailed as failed:
            if failed.kind != "stalled":
                raise
            work.notes.append(f"present: {failed.cause}; opened elsewhere")
    raise work.no_way("no place where the right arm can open the box that the left hand holds")


def _places(work: Work) -> Iterator[tuple[AirPlace, ChainQuery]]:
    """Yield places to open the box and what they must offer; with obstacles about, others around them as well."""
    for place in open_places():
        yield place, ROOMY
    if work.sight.obstacles:
        for shift in ELSEWHERE[1:]:
            for place in open_places():
                yield replace(place, center=place.center + np.array(shift)), NARROW


def _courses(
    work: Work, X_world_opening: Matrix, motions: Sequence[Sequence[HandWaypoint]], free: _Checker, query: ChainQuery
) -> tuple[Course, ...] | None:
    found: list[Course] = []
    for motion in motions:
        course = plan_course(work, "right", X_world_opening, motion, free, query)
        if course is None:
            return None
        found.append(course)
    return tuple(found)


def play(work: Work, guide: FieldGuide, opening: Opening, course: Course) -> Motion:
    """Carry out a motion in the opening's frame: travel to its first posture, aim by what is seen then, follow it."""
    work.phase = "travel"
    yield from lead_fingers(work.body, "right", course.waypoints[0].fingers)
    yield from work.travel("right", course.start)
    X_world_opening = work.sight.X_world_box @ opening_frame(work.box, opening)
    yield from follow_course(work, guide, "right", X_world_opening, course)
