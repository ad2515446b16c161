"""The five predicates on scripted events, without physics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from preshape.hal.transform import exp_so3, transform
from preshape.sim_backend.contact_scan import (
    FINGER_OUTSIDE,
    LEFT_ON_BOX,
    OTHER_ON_BOX,
    RIGHT_ON_BOX,
    RIGHT_ON_LID,
    TABLE_ON_BOX,
    THUMB_INSIDE,
)
from preshape.sim_backend.stages import Glance, Stages, opening_error, opening_frame

IDLE = Glance(0.0, 0, 0.2, False, 0.0, 0.0, False)
SIZE = np.array([0.06, 0.09, 0.20])


class Script:
    """Feeds stages with glances, 1 ms apart."""

    def __init__(self) -> None:
        self.stages, self.seconds = Stages(), 0.0

    def show(self, seconds: float, bits: int = 0, **changes: object) -> int:
        for _ in range(max(1, round(seconds * 1000))):
            self.seconds += 0.001
            self.stages.update(replace(IDLE, seconds=self.seconds, bits=bits, **changes))  # type: ignore[arg-type]
        return self.stages.stage

    def reach(self, stage: int) -> Script:
        if stage > 1:
            assert self.show(0.01, RIGHT_ON_BOX, lowest=0.06) == 2
        if stage > 2:
            self.stages.judge_opening(self.seconds, (0.001, 0.01))
            assert self.show(0.01, RIGHT_ON_BOX) == 3
        if stage > 3:
            assert self.show(0.6, LEFT_ON_BOX) == 4
        if stage > 4:
            self.show(0.01, LEFT_ON_BOX, tab_torn=True, tab_rad=0.6)
            assert self.show(0.3, LEFT_ON_BOX, tab_torn=True, is_clear=True) == 5
        return self


@pytest.mark.parametrize("also", [LEFT_ON_BOX, TABLE_ON_BOX, OTHER_ON_BOX])
def test_a_lift_counts_only_by_the_right_hand_alone(also: int) -> None:
    script = Script()
    assert script.show(1.0, RIGHT_ON_BOX | also, lowest=0.1) == 1
    assert script.show(1.0, RIGHT_ON_BOX, lowest=0.049) == 1
    assert script.show(1.0, 0, lowest=0.1) == 1
    assert script.show(0.001, RIGHT_ON_BOX, lowest=0.05) == 2
    assert script.stages.events["T1"] == script.seconds


def test_a_wrong_opening_goes_on_but_is_not_done() -> None:
    script = Script().reach(2)
    script.stages.judge_opening(script.seconds, (0.011, 0.0))
    assert script.show(0.01, RIGHT_ON_BOX) == 3 and not script.stages.done(2)
    script.stages.judge_opening(script.seconds, (0.0, np.deg2rad(5.1)))
    assert not script.stages.done(2)
    script.stages.judge_opening(script.seconds, (0.010, np.deg2rad(5.0)))
    assert script.stages.done(2)


def test_a_late_report_does_not_mend_task_two() -> None:
    script = Script().reach(2)
    script.stages.judge_opening(script.seconds, (1.0, 0.0))
    script.show(0.01, RIGHT_ON_BOX)
    assert script.show(0.6, LEFT_ON_BOX) == 4
    script.stages.judge_opening(script.seconds, (0.0, 0.0))
    assert not script.stages.done(2)


@pytest.mark.parametrize("also", [RIGHT_ON_BOX, TABLE_ON_BOX, OTHER_ON_BOX])
def test_the_left_hand_must_hold_alone_without_a_break(also: int) -> None:
    script = Script().reach(3)
    assert script.show(0.49, LEFT_ON_BOX) == 3
    assert script.show(0.001, LEFT_ON_BOX | also) == 3
    assert script.show(0.49, LEFT_ON_BOX) == 3
    assert script.show(0.02, LEFT_ON_BOX) == 4


def test_the_tab_must_be_torn_pushed_in_and_left() -> None:
    script = Script().reach(4)
    assert script.show(1.0, LEFT_ON_BOX, tab_rad=1.0, is_clear=True) == 4
    assert script.show(1.0, LEFT_ON_BOX, tab_torn=True, tab_rad=0.5, is_clear=True) == 4
    script.show(0.1, LEFT_ON_BOX, tab_torn=True, tab_rad=0.53)
    assert script.show(0.15, LEFT_ON_BOX, tab_torn=True, is_clear=True) == 4
    assert script.show(0.01, LEFT_ON_BOX, tab_torn=True) == 4
    assert script.show(0.21, LEFT_ON_BOX, tab_torn=True, is_clear=True) == 5


def test_a_lid_opened_without_a_pinch_is_not_done() -> None:
    script = Script().reach(5)
    script.show(0.1, RIGHT_ON_BOX | THUMB_INSIDE)
    script.show(0.1, RIGHT_ON_BOX)
    script.show(0.1, RIGHT_ON_BOX | FINGER_OUTSIDE)
    assert script.show(2.0, LEFT_ON_BOX, lid_rad=1.5) == 5


def test_a_pinched_lid_must_stay_open_after_release() -> None:
    script = Script().reach(5)
    script.show(0.1, RIGHT_ON_BOX | THUMB_INSIDE | FINGER_OUTSIDE)
    assert script.show(2.0, RIGHT_ON_BOX | RIGHT_ON_LID, lid_rad=1.5) == 5
    assert script.show(0.4, LEFT_ON_BOX, lid_rad=1.1) == 5
    assert script.show(0.4, LEFT_ON_BOX, lid_rad=1.0) == 5
    assert script.show(0.6, LEFT_ON_BOX, lid_rad=1.1) == 6
    assert all(script.stages.done(task) for task in range(1, 6))


def test_the_tab_frame_lies_on_its_face_at_its_edge() -> None:
    X = opening_frame(SIZE, "+x", "-y", 0.01, 0.04)
    assert np.allclose(X[:3, 3], [0.03, -0.045 + 0.02, 0.01])
    assert np.allclose(X[:3, 2], [1.0, 0.0, 0.0]) and np.allclose(X[:3, 0], [0.0, -1.0, 0.0])
    assert np.linalg.det(X[:3, :3]) == pytest.approx(1.0)


def test_the_error_of_an_opening_is_its_shift_and_turn() -> None:
    X = transform((0.5, 0.1, 0.3), exp_so3([0.3, -0.2, 0.5]))
    truth = ("+x", "+y", 0.002)
    assert opening_error(X, truth, X, truth, SIZE, 0.04) == pytest.approx((0.0, 0.0), abs=1e-9)  # type: ignore[arg-type]
    assert opening_error(X, truth, X, ("+x", "+y", 0.008), SIZE, 0.04) == pytest.approx((0.006, 0.0), abs=1e-9)  # type: ignore[arg-type]
    assert opening_error(X, truth, X, ("-x", "+y", 0.002), SIZE, 0.04)[1] > 3.0  # type: ignore[arg-type]
    assert opening_error(X, truth, X, ("+x", "-y", 0.002), SIZE, 0.04)[0] == pytest.approx(0.05)  # type: ignore[arg-type]
    moved = transform((0.003, 0.0, 0.0)) @ X
    assert opening_error(X, truth, moved, truth, SIZE, 0.04) == pytest.approx((0.003, 0.0), abs=1e-9)  # type: ignore[arg-type]
