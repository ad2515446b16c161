"""Laws of a hand motion with the arm postures that carry it out, on a real body without a simulator."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from preshape.control.body import Body
from preshape.control.course import SPEED_SHARE, Course, follow_course, plan_course
from preshape.control.opening_motion import HandWaypoint, thumb_out
from preshape.control.work import Work
from preshape.hal.layout import LAYOUT
from preshape.hal.sah_hand import FOREFINGERS
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, exp_so3, transform
from preshape.planner.arm_kinematics import palm_pose
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import workcell

PERIOD_S = 0.002
CELL = workcell(Scenario(name="cell"))
BASE = CELL.X_world_base["right"]
EASY = np.array([-1.372, -0.859, 1.185, -2.359, 0.814, 1.836, -0.890])
X_WORLD_OPENING = transform((0.4, -0.2, 0.4), exp_so3(np.array([0.1, 0.2, 0.3])))
X_OPENING_EASY = np.linalg.inv(X_WORLD_OPENING) @ palm_pose("right", BASE, EASY)


def waypoints() -> tuple[HandWaypoint, ...]:
    fist, flat = thumb_out(), thumb_out(folded=False)
    steps = [transform(), transform((0.0, 0.0, 0.02)), transform((0.0, 0.0, 0.02), exp_so3(np.array([0.0, 0.5, 0.0])))]
    poses = [X_OPENING_EASY @ step for step in steps]
    return (
        HandWaypoint("above", poses[0], fist, 0.3),
        HandWaypoint("down", poses[1], fist, 0.4),
        HandWaypoint("turned", poses[2], flat, 0.5, 0.2),
    )


def ground() -> Work:
    """Return the part of `Work` that a course needs, at rest with the arm at the easy posture."""
    body = Body(CELL, PERIOD_S)
    position = 0.5 * (LAYOUT.lower + LAYOUT.upper)
    position[LAYOUT.arm("right")] = EASY
    body.follow(position, np.zeros(LAYOUT.dof))
    return cast(Work, SimpleNamespace(cell=CELL, body=body, sight=SimpleNamespace(X_world_box=transform()), phase=""))


def planned(work: Work) -> Course:
    course = plan_course(work, "right", X_WORLD_OPENING, waypoints(), lambda number, q: True)
    assert course is not None
    return course


def test_every_leg_ends_at_a_posture_that_has_the_palm_at_its_way_point() -> None:
    course = planned(ground())
    assert [len(leg) for leg in course.legs] == [1, 1, 3]
    for waypoint, leg in zip(course.waypoints, course.legs, strict=True):
        X = X_WORLD_OPENING @ waypoint.X_opening_palm
        np.testing.assert_allclose(palm_pose("right", BASE, leg[-1]), X, atol=1e-6)
    np.testing.assert_array_equal(course.start, course.legs[0][-1])


@pytest.mark.parametrize("refused", range(3))
def test_a_way_point_that_is_not_free_leaves_no_course_and_each_is_asked_by_its_number(refused: int) -> None:
    asked: set[int] = set()

    def is_free(number: int, q: Vector) -> bool:
        asked.add(number)
        return number != refused

    assert plan_course(ground(), "right", X_WORLD_OPENING, waypoints(), is_free) is None
    assert asked == set(range(refused + 1))


def test_a_way_point_out_of_reach_leaves_no_course() -> None:
    far = waypoints()
    far = (*far[:2], HandWaypoint("far", transform((5.0, 0.0, 0.0)), far[2].fingers, 1.0))
    assert plan_course(ground(), "right", X_WORLD_OPENING, far, lambda number, q: True) is None


def test_following_visits_every_way_point_in_order_and_says_so() -> None:
    work = ground()
    course = planned(work)
    ends: dict[str, Matrix] = {}
    for _ in follow_course(work, "right", X_WORLD_OPENING, course):
        ends[work.phase] = work.body.asked_palm("right").copy()
    assert list(ends) == ["above", "down", "turned"]
    for waypoint in course.waypoints:
        np.testing.assert_allclose(ends[waypoint.name], X_WORLD_OPENING @ waypoint.X_opening_palm, atol=1e-7)
    np.testing.assert_allclose(work.body.asked_fingers("right"), course.waypoints[-1].fingers, atol=1e-12)


def test_a_leg_takes_its_time_or_what_the_joints_speed_share_needs() -> None:
    work = ground()
    course = planned(work)
    ticks_of: dict[str, int] = {}
    for _ in follow_course(work, "right", X_WORLD_OPENING, course):
        ticks_of[work.phase] = ticks_of.get(work.phase, 0) + 1
    limit = LAYOUT.velocity[LAYOUT.arm("right")]
    last = course.start
    for waypoint, leg in zip(course.waypoints, course.legs, strict=True):
        assert ticks_of[waypoint.name] >= round(waypoint.duration_s / PERIOD_S)
        knots = np.vstack([last, leg])
        # An eased leg through n equal steps moves at most 15/8 n times its largest step in its time.
        fastest = 15.0 / 8.0 * (len(knots) - 1) * np.abs(np.diff(knots, axis=0)).max(axis=0)
        assert np.all(fastest / (ticks_of[waypoint.name] * PERIOD_S) <= SPEED_SHARE * limit * 1.01)
        last = leg[-1]


def test_only_the_fingers_other_than_the_thumb_are_capped_and_only_where_asked() -> None:
    work = ground()
    capped: dict[str, Matrix] = {}
    hand = LAYOUT.hand("right")
    for _ in follow_course(work, "right", X_WORLD_OPENING, planned(work)):
        capped[work.phase] = work.body.setpoint().torque_limit[hand].copy()
    np.testing.assert_array_equal(capped["down"], LAYOUT.torque[hand])
    fingers = np.concatenate([np.arange(LAYOUT.dof)[LAYOUT.finger("right", f)] for f in FOREFINGERS]) - hand.start
    expected = LAYOUT.torque[hand].copy()
    expected[fingers] = np.minimum(expected[fingers], 0.2)
    np.testing.assert_array_equal(capped["turned"], expected)
