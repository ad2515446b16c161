"""Laws of one hand's grasp on scripted torques: fingers are springs that meet a box at chosen angles."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.grasp import BEHIND_RAD, MOST_TRAVEL, OPENING_SPEED, SENSELESS_NM, Grasp, GraspStatus
from preshape.control.grip import Grip
from preshape.control.grips import brace_grip, cage_grip
from preshape.control.touch import FROZEN_TICKS
from preshape.hal.layout import HAND_DOF, LAYOUT
from preshape.hal.sah_hand import ACTUATED
from preshape.hal.state import Vector

DT = 0.002
SIZE = np.array([0.06, 0.09, 0.20])
SPRING = 8.0
"""Torque of a joint that is pressed into the box, N m/rad."""
STIFF = 17.0
"""The same of the drives in physics on a box that gives way nowhere, N m/rad."""
HAND = LAYOUT.hand("right")


class Box:
    """Answers every driven joint with a spring from `gap` rad beyond the angle where closing began."""

    def __init__(self, grip: Grip, gap: float) -> None:
        self._rng = np.random.default_rng(7)
        self._sign = np.nan_to_num(np.sign(grip.torques))
        self._wall = grip.preshape + self._sign * gap
        self.there, self.spring = True, SPRING
        self.silent: list[int] = []
        self._said = np.zeros(HAND_DOF)

    def answer(self, target: Vector) -> Vector:
        """Return the torques (13) at these commanded angles, with noise; silent joints repeat their last value."""
        into = np.maximum(self._sign * (target - self._wall), 0.0) if self.there else np.zeros(HAND_DOF)
        torque = self._sign * self.spring * into + self._rng.normal(0.0, 0.005, HAND_DOF)
        torque[self.silent] = self._said[self.silent]
        self._said = torque
        return torque

    def stopped(self, target: Vector) -> Vector:
        """Return the angles (13) that joints reach at these commanded ones: silent joints stop at the box."""
        position = target.copy()
        beyond = self._sign * (target - self._wall) > 0.0
        blocked = [joint for joint in self.silent if self.there and beyond[joint]]
        position[blocked] = self._wall[blocked]
        return position


class Bench:
    """A grasp and its box, stepped together."""

    def __init__(self, grip: Grip, gap: float = 0.1) -> None:
        self.grip, self.box = grip, Box(grip, gap)
        self.grasp = Grasp(grip, grip.preshape)
        self.target = grip.preshape.copy()
        self.limit = np.zeros(HAND_DOF)
        self.torque = np.zeros(HAND_DOF)
        self.age_s = 0.001

    def run(self, seconds: float, until: GraspStatus | None = None) -> list[Vector]:
        """Step for a time or until a state is reached; return the targets asked for."""
        targets: list[Vector] = []
        for _ in range(round(seconds / DT)):
            if self.grasp.status is until:
                break
            self.torque = self.box.answer(self.target)
            position = self.box.stopped(self.target)
            self.target, self.limit = self.grasp.step(DT, position, self.torque, self.age_s)
            targets.append(self.target)
        return targets

    def held(self) -> Bench:
        """Close until held."""
        self.grasp.close()
        self.run(8.0, GraspStatus.HOLDING)
        assert self.grasp.status is GraspStatus.HOLDING
        return self


def both() -> list[Grip]:
    return [cage_grip(SIZE, "+z", "+y", "right"), brace_grip(SIZE, "+z", "+x", "right")]


@pytest.mark.parametrize("grip", both(), ids=lambda grip: grip.name)
@pytest.mark.parametrize("gap", [0.02, 0.1, 0.3])
def test_closes_on_a_box_and_holds_it_with_the_grips_torques(grip: Grip, gap: float) -> None:
    bench = Bench(grip, gap)
    assert bench.grasp.status is GraspStatus.OPEN
    bench.held().run(3.0)
    assert bench.grasp.status is GraspStatus.HOLDING
    driven = np.isfinite(grip.torques)
    np.testing.assert_allclose(bench.torque[driven], grip.torques[driven], rtol=0.2)


@pytest.mark.parametrize("grip", both(), ids=lambda grip: grip.name)
def test_no_torque_overshoots_its_goal_on_a_stiff_box(grip: Grip) -> None:
    bench = Bench(grip)
    bench.box.spring = STIFF
    bench.grasp.close()
    most = np.zeros(HAND_DOF)
    for _ in range(round(8.0 / DT)):
        bench.run(DT)
        most = np.maximum(most, np.abs(bench.torque))
    assert bench.grasp.status is GraspStatus.HOLDING
    driven = np.isfinite(grip.torques)
    assert np.all(most[driven] <= 1.05 * np.abs(grip.torques[driven]) + 0.02)


@pytest.mark.parametrize("grip", both(), ids=lambda grip: grip.name)
def test_every_target_is_within_the_joint_limits(grip: Grip) -> None:
    bench = Bench(grip)
    bench.grasp.close()
    targets = np.array(bench.run(8.0))
    assert np.all(targets >= LAYOUT.lower[HAND] - 1e-12) and np.all(targets <= LAYOUT.upper[HAND] + 1e-12)


def test_a_finger_that_has_met_the_box_waits_for_its_opponent() -> None:
    grip = cage_grip(SIZE, "+z", "+y", "right")
    bench = Bench(grip, 0.05)
    thumb, middle = ACTUATED.index("thumb_flex"), ACTUATED.index("middle_flex")
    bench.box._wall[middle] += 0.3
    bench.grasp.close()
    targets = np.array(bench.run(0.9))
    late = targets[-150:]
    assert np.ptp(late[:, thumb]) == 0.0
    assert np.ptp(late[:, middle]) > 0.05


def test_nothing_between_the_fingers_is_named_as_missed() -> None:
    bench = Bench(cage_grip(SIZE, "+z", "+y", "right"))
    bench.box.there = False
    bench.grasp.close()
    bench.run(8.0, GraspStatus.MISSED)
    assert bench.grasp.status is GraspStatus.MISSED and bench.grasp.status.failed
    assert bench.grasp.reason == "has closed without meeting the box"


def test_a_box_that_is_lost_is_named_as_slipped_after_the_most_travel() -> None:
    bench = Bench(cage_grip(SIZE, "+z", "+y", "right")).held()
    held = bench.target.copy()
    bench.box.there = False
    bench.run(30.0, GraspStatus.SLIPPED)
    assert bench.grasp.status is GraspStatus.SLIPPED and bench.grasp.status.failed
    assert bench.grasp.reason == "has closed further than a held box allows"
    assert MOST_TRAVEL < np.abs(bench.target - held).max() < MOST_TRAVEL + 0.01


def test_easing_lowers_the_held_torques_to_their_share() -> None:
    bench = Bench(brace_grip(SIZE, "+z", "+x", "right")).held()
    bench.run(3.0)
    thumb = ACTUATED.index("thumb_flex")
    full = bench.torque[thumb]
    bench.grasp.ease(0.6)
    bench.run(5.0)
    assert bench.torque[thumb] == pytest.approx(0.6 * full, rel=0.1)


def test_stale_samples_are_not_integrated_on_and_tighten_the_torque_limits() -> None:
    bench = Bench(cage_grip(SIZE, "+z", "+y", "right")).held()
    bench.run(1.0)
    np.testing.assert_array_equal(bench.limit, LAYOUT.torque[HAND])
    held, bench.age_s = bench.target.copy(), 0.2
    bench.box.there = False
    bench.run(1.0)
    np.testing.assert_array_equal(bench.target, held)
    driven = np.isfinite(bench.grip.torques)
    expected = np.maximum(np.abs(bench.grip.torques[driven]), 0.2)
    np.testing.assert_allclose(bench.limit[driven], np.minimum(expected, LAYOUT.torque[HAND][driven]))
    assert np.all(bench.limit <= LAYOUT.torque[HAND]) and np.any(bench.limit < LAYOUT.torque[HAND])


def test_a_frozen_sensor_tightens_its_own_limit_alone_and_its_pair_stands_still() -> None:
    bench = Bench(cage_grip(SIZE, "+z", "+y", "right")).held()
    thumb, middle = ACTUATED.index("thumb_flex"), ACTUATED.index("middle_flex")
    bench.box.silent = [thumb]
    bench.run((FROZEN_TICKS + 2) * DT)
    still = bench.run(0.5)
    assert np.ptp(np.array(still)[:, [thumb, middle]], axis=0).max() == 0.0
    assert np.flatnonzero(bench.limit < LAYOUT.torque[HAND]).tolist() == [thumb]
    assert bench.limit[thumb] == pytest.approx(abs(bench.grip.torques[thumb]))


@pytest.mark.parametrize("name", ["thumb_flex", "middle_flex"])
@pytest.mark.parametrize("grip", both(), ids=lambda grip: grip.name)
def test_a_finger_whose_sensor_was_frozen_before_closes_by_what_it_may_push_and_never_pushes_more(
    grip: Grip, name: str
) -> None:
    joint = ACTUATED.index(name)
    bench = Bench(grip, 0.2)
    bench.box.silent = [joint]
    bench.run((FROZEN_TICKS + 2) * DT)
    bench.grasp.close()
    most = 0.0
    while bench.grasp.status is GraspStatus.CLOSING:
        stage = bench.grasp._stage
        bench.run(DT)
        meeting = stage == bench.grasp._stage and grip.stages[stage].touch
        assert not meeting or bench.limit[joint] <= SENSELESS_NM + 1e-12
        most = max(most, bench.limit[joint])
    assert bench.grasp.status is GraspStatus.HOLDING
    assert most == pytest.approx(max(abs(grip.torques[joint]), SENSELESS_NM))
    assert abs(bench.target[joint] - bench.box.stopped(bench.target)[joint]) > BEHIND_RAD


def test_a_finger_without_a_sensor_that_meets_nothing_has_missed() -> None:
    bench = Bench(cage_grip(SIZE, "+z", "+y", "right"))
    bench.box.silent, bench.box.there = [ACTUATED.index("thumb_flex")], False
    bench.grasp.close()
    bench.run(8.0, GraspStatus.MISSED)
    assert bench.grasp.status is GraspStatus.MISSED


@pytest.mark.parametrize("grip", both(), ids=lambda grip: grip.name)
def test_opening_ends_at_the_preshape_no_faster_than_allowed_driven_joints_first(grip: Grip) -> None:
    bench = Bench(grip, 0.2).held()
    start = bench.target.copy()
    bench.grasp.open()
    targets = np.array([start, *bench.run(4.0, GraspStatus.OPEN)])
    assert bench.grasp.status is GraspStatus.OPEN
    np.testing.assert_allclose(targets[-1], grip.preshape, atol=1.1e-3)
    assert np.abs(np.diff(targets, axis=0)).max() <= OPENING_SPEED * DT + 1e-12
    driven = np.isfinite(grip.torques)
    moved_on = np.flatnonzero(np.abs(targets[:, ~driven] - start[~driven]).max(axis=1) > 0.0)
    assert moved_on.size and np.abs(targets[moved_on[0] - 1] - grip.preshape)[driven].max() <= 0.03 + 1e-9
