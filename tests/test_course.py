"""Laws of a hand motion with the arm postures that carry it out, on a real body without a simulator."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from preshape.control.approach import FieldGuide
from preshape.control.body import Body
from preshape.control.contact_policy import Phase
from preshape.control.course import SPEED_SHARE, Course, follow_course, plan_course
from preshape.control.failure import TaskFailed
from preshape.control.field import FieldOptions
from preshape.control.opening_motion import HandWaypoint, thumb_out
from preshape.control.work import Work
from preshape.hal.layout import LAYOUT
from preshape.hal.sah_hand import ACTUATED, FOREFINGERS
from preshape.hal.state import RobotState, Vector
from preshape.hal.transform import Matrix, exp_so3, transform
from preshape.hal.world import NominalBox
from preshape.planner.arm_kinematics import palm_pose
from preshape.planner.work_object import box_object
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import workcell

PERIOD_S = 0.002
BOX = NominalBox(np.array([0.06, 0.09, 0.20]), ("+x", "-x"))
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
    measured(body, position)
    sight = SimpleNamespace(estimate=None, X_world_box=transform(), obstacles=[])
    return cast(Work, SimpleNamespace(cell=CELL, body=body, sight=sight, phase="", notes=[]))


def measured(body: Body, position: Vector, torque: Vector | None = None) -> None:
    """Let the joints be measured at some angles, rad, with torques, N m (default: none)."""
    zero = np.zeros(LAYOUT.dof)
    body.update(0, RobotState(0, position, zero, zero if torque is None else torque, np.zeros(LAYOUT.dof, np.int64)))


def followed(
    work: Work,
    course: Course,
    felt: Callable[[Work], dict[str, float]] = lambda work: {},
    frozen: tuple[str, ...] = (),
) -> Iterator[str]:
    """Follow a course with joints that do as they are told; `felt` says which of the hand's feel what, N m.

    Sensors are noisy but for those that are `frozen`.
    """
    noise = np.random.default_rng(3)
    guide = FieldGuide(work.body, work.sight, BOX, box_object(BOX), FieldOptions())
    position = work.body.position.copy()
    for _ in follow_course(work, guide, "right", X_WORLD_OPENING, course):
        yield work.phase
        target = work.body.setpoint().position
        position[LAYOUT.hand("right")] = target[LAYOUT.hand("right")]
        torque = noise.normal(0.0, 0.005, LAYOUT.dof)
        torque[[LAYOUT.hand("right").start + ACTUATED.index(name) for name in frozen]] = 0.01
        for name, value in felt(work).items():
            torque[LAYOUT.hand("right").start + ACTUATED.index(name)] = value
        measured(work.body, position, torque)


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
    for _ in followed(work, course):
        ends[work.phase] = work.body.asked_palm("right").copy()
    assert list(ends) == ["above", "down", "turned"]
    for waypoint in course.waypoints:
        np.testing.assert_allclose(ends[waypoint.name], X_WORLD_OPENING @ waypoint.X_opening_palm, atol=1e-7)
    np.testing.assert_allclose(work.body.asked_fingers("right"), course.waypoints[-1].fingers, atol=1e-12)


def test_a_leg_takes_its_time_or_what_the_joints_speed_share_needs() -> None:
    work = ground()
    course = planned(work)
    ticks_of: dict[str, int] = {}
    for _ in followed(work, course):
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
    for _ in followed(work, planned(work)):
        capped[work.phase] = work.body.setpoint().torque_limit[hand].copy()
    np.testing.assert_array_equal(capped["down"], LAYOUT.torque[hand])
    fingers = np.concatenate([np.arange(LAYOUT.dof)[LAYOUT.finger("right", f)] for f in FOREFINGERS]) - hand.start
    expected = LAYOUT.torque[hand].copy()
    expected[fingers] = np.minimum(expected[fingers], 0.2)
    np.testing.assert_array_equal(capped["turned"], expected)


def pinching(work: Work) -> Course:
    """Return a course that pinches, turns in two legs and lets go."""
    fist, closed = thumb_out(), thumb_out(folded=False)
    poses = [X_OPENING_EASY @ transform(R=exp_so3(np.array([0.0, 0.1 * k, 0.0]))) for k in range(3)]
    steps = (
        HandWaypoint("hook", poses[0], fist, 0.1, 0.2, Phase.PINCH, free=True),
        HandWaypoint("pinch", poses[0], closed, 0.2, 0.2, Phase.PINCH, meets=True),
        HandWaypoint("turn", poses[1], closed, 0.2, 0.2, Phase.PINCH, opened=fist),
        HandWaypoint("end", poses[2], closed, 0.2, 0.2, Phase.PINCH, meets=True, opened=fist),
        HandWaypoint("let go", poses[2], fist, 0.2, phase=Phase.PINCH),
    )
    course = plan_course(work, "right", X_WORLD_OPENING, steps, lambda number, q: True)
    assert course is not None
    return course


def closed_in(phases: str, met: dict[str, float]) -> Callable[[Work], dict[str, float]]:
    """Feel torques in some phases once the fore finger is half closed."""

    def felt(work: Work) -> dict[str, float]:
        half = work.body.asked_fingers("right")[ACTUATED.index("fore_flex")] < 0.5
        return met if work.phase in phases.split(", ") and half else {}

    return felt


BOTH = {"thumb_opp": 0.3, "fore_flex": -0.2}


@pytest.mark.parametrize("finger", ["fore_flex", "fore_pip", "middle_flex"])
def test_a_pinch_that_has_met_the_opening_is_kept_while_the_hand_turns(finger: str) -> None:
    work = ground()
    course = pinching(work)
    fore = {
        phase: work.body.asked_fingers("right")[ACTUATED.index("fore_flex")]
        for phase in followed(work, course, closed_in("pinch, turn, end", {"thumb_opp": 0.3, finger: -0.2}))
    }
    closed = course.waypoints[1].fingers[ACTUATED.index("fore_flex")]
    assert fore["turn"] == pytest.approx(closed) and fore["end"] == pytest.approx(closed)
    assert work.notes == []


@pytest.mark.parametrize("felt", [{}, {"thumb_opp": 0.3}, {"fore_flex": -0.2}, {"thumb_opp": 0.3, "ring_flex": -0.2}])
def test_a_pinch_that_has_missed_turns_with_the_fingers_opened_and_closes_anew_at_the_end(
    felt: dict[str, float],
) -> None:
    work = ground()
    course = pinching(work)
    joint, turned = ACTUATED.index("fore_flex"), []
    missed, met = closed_in("pinch", felt), closed_in("end", BOTH)
    for phase in followed(work, course, lambda work: {**missed(work), **met(work)}):
        if phase == "turn":
            turned.append(work.body.asked_fingers("right")[joint])
    assert turned[-1] == pytest.approx(course.waypoints[2].opened[joint])
    assert len(work.notes) == 1 and "pinch: no finger has met the opening" in work.notes[0]


def test_a_pinch_that_misses_twice_fails_by_name() -> None:
    work = ground()
    with pytest.raises(TaskFailed, match="missed: no finger has met the opening from outside"):
        for _ in followed(work, pinching(work)):
            pass


@pytest.mark.parametrize("frozen", ["fore_flex", "middle_pip"])
def test_a_finger_that_could_not_be_felt_is_taken_to_have_met_the_opening(frozen: str) -> None:
    work = ground()
    course = pinching(work)
    thumb = closed_in("pinch", {"thumb_opp": 0.3})
    for _ in followed(work, course, thumb, (frozen,)):
        pass
    assert work.notes == []
    with pytest.raises(TaskFailed, match="missed"):
        for _ in followed(ground(), course, thumb, ("ring_flex",)):
            pass
