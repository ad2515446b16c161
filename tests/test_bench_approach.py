"""The field alone: starts have room and are the seed's, and the hand comes to its goal without touching anything."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.approach import ApproachLimits
from preshape.control.distances import Boxes
from preshape.hal.transform import transform
from preshape.hal.world import OrientedBox
from preshape.tools.bench_approach import VARIANTS, ApproachBench
from preshape.tools.field_flight import FieldFlight, fly
from preshape.tools.random_approach import ROOM_M, least_gap, random_approach


def test_the_seed_alone_decides_the_start() -> None:
    first, again = (random_approach(np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(first.position, again.position)
    assert [post.half.tolist() for post in first.posts] == [post.half.tolist() for post in again.posts]
    assert random_approach(np.random.default_rng(4)).position[0] != first.position[0]


@pytest.mark.parametrize("apart", [0.3, 0.05, -0.02])
def test_the_least_gap_is_the_nearest_pairs(apart: float) -> None:
    def cube(x: float) -> OrientedBox:
        return OrientedBox("cube", transform((x, 0.0, 0.0)), np.full(3, 0.1))

    boxes, others = Boxes.of([cube(-9.0), cube(0.0)]), Boxes.of([cube(0.2 + apart), cube(5.0), cube(7.0)])
    assert least_gap(boxes, others) == pytest.approx(apart, abs=1e-9)


def test_a_hand_among_posts_reaches_its_goal_and_touches_none() -> None:
    flight = fly(random_approach(np.random.default_rng(3)), VARIANTS["grouped, smooth ties, L2 (default)"])
    assert flight.end == "reached" and 0.0 < flight.least_gap_m
    assert 1.0 < flight.seconds < 10.0


def test_a_hand_that_has_no_time_is_timed_out() -> None:
    limits = ApproachLimits(time_s=0.2)
    flight = fly(random_approach(np.random.default_rng(3)), VARIANTS["hard tie sets"], limits)
    assert flight.end == "timed out" and flight.seconds == pytest.approx(0.2)
    assert flight.least_gap_m > 0.5 * ROOM_M


def test_what_touched_something_has_not_reached() -> None:
    flights = [
        FieldFlight("reached", 2.0, 0.01),
        FieldFlight("reached", 3.0, -0.001),
        FieldFlight("stalled", 4.0, 0.02),
    ]
    line = ApproachBench(0, {"field": flights}).lines()[2]
    assert line.split() == ["field", "1", "1", "1", "0", "2.00", "2.00", "10.0"]
