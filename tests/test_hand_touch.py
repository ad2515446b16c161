"""Laws of which members of a hand have met something."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from preshape.control.body import Body
from preshape.control.groups import MEMBERS, Member
from preshape.control.hand_touch import BLOCKED_RAD, HandTouch
from preshape.control.touch import BIAS_TICKS, FROZEN_TICKS, TOUCH_NM, TOUCH_TICKS
from preshape.hal.layout import LAYOUT, SIDES, Side, finger_slice

FINGERS: tuple[Member, ...] = tuple(member for member in MEMBERS if member != "palm")


class Bench:
    """A body whose torques and joint angles the test says."""

    def __init__(self, side: Side) -> None:
        zero = np.zeros(LAYOUT.dof)
        self.body = SimpleNamespace(torque=zero.copy(), position=zero.copy(), commanded=(zero, zero))
        self.touch, self.hand = HandTouch(side, cast(Body, self.body)), LAYOUT.hand(side)
        self.run(BIAS_TICKS)

    def run(self, ticks: int) -> set[str]:
        for _ in range(ticks):
            self.touch.update()
        return {member for member in MEMBERS if self.touch.met(member)}


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("member", FINGERS)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_finger_has_met_something_when_a_torque_of_its_joints_lasts(side: Side, member: Member, sign: float) -> None:
    for joint in range(*finger_slice(member).indices(13)):
        bench = Bench(side)
        bench.body.torque[bench.hand.start + joint] = sign * 1.1 * TOUCH_NM
        assert bench.run(TOUCH_TICKS - 1) == set()
        assert bench.run(1) == {member}


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("member", FINGERS)
def test_a_finger_has_met_something_when_it_stays_behind_its_command(side: Side, member: Member) -> None:
    bench = Bench(side)
    joint = bench.hand.start + finger_slice(member).start
    bench.body.position[joint] = 0.9 * BLOCKED_RAD
    assert bench.run(10 * TOUCH_TICKS) == set()
    bench.body.position[joint] = 1.1 * BLOCKED_RAD
    assert bench.run(TOUCH_TICKS) == {member}


@pytest.mark.parametrize("member", FINGERS)
def test_a_finger_with_a_frozen_sensor_is_blind_and_the_others_are_not(member: Member) -> None:
    bench = Bench("right")
    joint = bench.hand.start + finger_slice(member).start
    rng = np.random.default_rng(1)
    for _ in range(FROZEN_TICKS + 1):
        bench.body.torque[:] = rng.normal(0.0, 0.01, LAYOUT.dof)
        bench.body.torque[joint] = 0.02
        bench.run(1)
    assert {other for other in MEMBERS if bench.touch.blind(other)} == {member}


def test_the_other_hand_does_not_count() -> None:
    bench = Bench("right")
    bench.body.torque[LAYOUT.hand("left")] = 1.0
    assert bench.run(10 * TOUCH_TICKS) == set()


def test_a_hand_taken_to_be_free_has_met_nothing_until_its_torques_change_again() -> None:
    bench = Bench("right")
    bench.body.torque[bench.hand] = 0.5
    assert bench.run(TOUCH_TICKS) == set(FINGERS)
    bench.touch.forget()
    assert bench.run(BIAS_TICKS + 10 * TOUCH_TICKS) == set()
    bench.body.torque[bench.hand] = 0.3
    assert bench.run(TOUCH_TICKS) == set(FINGERS)
