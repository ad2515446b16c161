"""Laws of how a carried box hangs on the thumb."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from preshape.control.hanging import hanging
from preshape.hal.transform import Matrix, axis_rotation, exp_so3

PALM_DOWN = np.diag([1.0, -1.0, -1.0])
turns = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(lambda v: exp_so3(np.array(v)))


def _rolled(angle: float) -> Matrix:
    """Return the attitude of a palm that looked down and was turned about its y axis."""
    return PALM_DOWN @ axis_rotation(np.array([0.0, 1.0, 0.0]), angle)


def test_a_box_that_lies_on_the_thumb_hangs_on_it_and_one_that_lies_on_the_fingers_does_not() -> None:
    below = [R[2, 0] for R in (_rolled(np.pi / 2), _rolled(-np.pi / 2))]
    assert sorted(below) == pytest.approx([-1.0, 1.0])
    onto_thumb, onto_fingers = (_rolled(np.pi / 2 * s) for s in ((1, -1) if below[0] < 0 else (-1, 1)))
    assert hanging(np.array([PALM_DOWN, onto_thumb, PALM_DOWN])) == pytest.approx(1.0)
    assert hanging(np.array([PALM_DOWN, onto_fingers])) == pytest.approx(0.0)


@given(turns, st.floats(-3.0, 3.0))
def test_turning_about_the_vertical_changes_nothing(R: Matrix, angle: float) -> None:
    turned = exp_so3(np.array([0.0, 0.0, angle])) @ R
    assert hanging(np.array([R, turned])) == pytest.approx(hanging(R[None]), abs=1e-9)


@given(turns, turns)
def test_the_worst_attitude_of_a_way_counts(A: Matrix, B: Matrix) -> None:
    assert hanging(np.array([A, B])) == max(hanging(A[None]), hanging(B[None]))
