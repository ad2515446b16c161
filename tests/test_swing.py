"""Laws of what a way costs a carrying hand's grip."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from preshape.control.swing import HANGING_RAD, swing
from preshape.hal.transform import Matrix, exp_so3

turns = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(lambda v: exp_so3(np.array(v)))
SHARES = np.linspace(0.0, 1.0, 200)


def _turned(R: Matrix, axis: Matrix, angle: float) -> Matrix:
    """Return attitudes (n, 3, 3): R turned about a world axis, by more and more."""
    return np.array([exp_so3(share * angle * np.asarray(axis, float)) @ R for share in SHARES])


def _hanging(R: Matrix) -> float:
    return HANGING_RAD * max(0.0, -float(R[2, 0]))


@given(turns, st.floats(-3.0, 3.0))
def test_turning_about_the_vertical_costs_nothing_but_how_the_box_hangs(R: Matrix, angle: float) -> None:
    assert swing(_turned(R, np.array([0.0, 0.0, 1.0]), angle)) == pytest.approx(_hanging(R), abs=1e-9)


@given(st.floats(-1.5, 1.5))
def test_tilting_the_fingers_up_or_down_costs_its_angle(angle: float) -> None:
    palm_down = np.diag([1.0, -1.0, -1.0])
    assert swing(_turned(palm_down, np.array([1.0, 0.0, 0.0]), angle)) == pytest.approx(abs(angle), abs=1e-4)


def test_hanging_on_the_thumb_costs_more_than_on_the_fingers() -> None:
    palm_down = np.diag([1.0, -1.0, -1.0])
    onto_thumb = _turned(palm_down, np.array([0.0, 1.0, 0.0]), np.pi / 2)
    onto_fingers = _turned(palm_down, np.array([0.0, 1.0, 0.0]), -np.pi / 2)
    assert sorted([-onto_thumb[-1][2, 0], -onto_fingers[-1][2, 0]]) == pytest.approx([-1.0, 1.0])
    assert swing(onto_thumb) == pytest.approx(np.pi / 2 + HANGING_RAD, abs=1e-4)
    assert swing(onto_fingers) == pytest.approx(np.pi / 2, abs=1e-4)


@given(turns, turns, turns)
def test_a_detour_costs_no_less_than_part_of_it(A: Matrix, B: Matrix, C: Matrix) -> None:
    assert swing(np.array([A, C])) <= swing(np.array([A, B, C])) + 1e-9
