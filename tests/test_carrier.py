"""The held box that moves to and fro while the other hand comes."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.body import Body
from preshape.control.carrier import Carrier, CarryOptions, sweep
from preshape.hal.layout import LAYOUT
from preshape.hal.state import RobotState
from preshape.hal.transform import inverse, log_so3, transform
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import workcell
from preshape.sim_backend.simulation import home_position

PERIOD = 0.002


def resting_body() -> Body:
    body = Body(workcell(Scenario(name="x")), PERIOD)
    q = home_position()
    zeros = np.zeros(LAYOUT.dof)
    body.follow(q, zeros)
    body.update(0, RobotState(0, q, zeros, zeros, np.zeros(LAYOUT.dof, dtype=np.int64)))
    return body


def swing(options: CarryOptions, seconds: float) -> tuple[list[np.ndarray], Carrier]:
    body = resting_body()
    X_palm_box = transform((0.0, 0.0, 0.28))
    X_seen = body.palm("right") @ X_palm_box
    carrier = Carrier(body, "right", X_palm_box, options)
    poses = []
    for _ in range(round(seconds / PERIOD)):
        carrier.step(X_seen)
        poses.append(carrier.X_world_box)
    return poses, carrier


def test_the_box_moves_at_its_speeds_and_turns_round_within_its_span() -> None:
    options = CarryOptions(speed=0.05, turn_speed=0.35)
    poses, _ = swing(options, 8.0)
    heights = np.array([X[2, 3] for X in poses])
    speeds = np.abs(np.diff(heights)) / PERIOD
    assert speeds.max() == pytest.approx(0.05, rel=1e-6)
    assert np.ptp(heights) <= 0.05 * (options.span_s + options.ramp_s)
    turns = [np.linalg.norm(log_so3(A[:3, :3].T @ B[:3, :3])) for A, B in zip(poses[:-1], poses[1:], strict=True)]
    assert max(turns) / PERIOD == pytest.approx(0.35, rel=1e-4)


@pytest.mark.parametrize("seconds", [0.05, 0.6, 1.1, 1.9, 2.7])
def test_told_to_stop_it_comes_home_softly_wherever_it_is(seconds: float) -> None:
    body = resting_body()
    options = CarryOptions(speed=0.05, turn_speed=0.35)
    carrier = Carrier(body, "right", transform((0.0, 0.0, 0.28)), options)
    X_home = carrier.X_world_box
    for _ in range(round(seconds / PERIOD)):
        carrier.step(carrier.X_world_box)
    carrier.stop()
    heights = [carrier.X_world_box[2, 3]]
    while not carrier.stopped:
        carrier.step(carrier.X_world_box)
        heights.append(carrier.X_world_box[2, 3])
        assert len(heights) * PERIOD < 5.0
    np.testing.assert_allclose(carrier.X_world_box, X_home, atol=1e-9)
    speeds = np.diff(heights) / PERIOD
    assert np.abs(speeds).max() <= 0.05 + 1e-9
    # Softly: no jump in speed but the last one, of a few mm/s.
    assert np.abs(np.diff(speeds))[:-1].max() <= 1.01 * 0.05 * PERIOD / options.ramp_s + 1e-4
    assert abs(speeds[-1]) < 0.005


def test_a_box_that_does_not_move_asks_nothing_of_the_palm() -> None:
    body = resting_body()
    before = body.asked_palm("right").copy()
    carrier = Carrier(body, "right", transform((0.0, 0.0, 0.28)), CarryOptions())
    for _ in range(50):
        carrier.step(carrier.X_world_box)
    assert carrier.stopped and carrier.twist is None
    assert np.array_equal(body.asked_palm("right"), before)


def test_without_feed_forward_the_hand_gets_only_what_is_seen() -> None:
    body = resting_body()
    carrier = Carrier(body, "right", transform((0.0, 0.0, 0.28)), CarryOptions(speed=0.05, feed_forward=False))
    seen = transform((0.5, 0.0, 0.4))
    carrier.step(seen)
    assert carrier.twist is None and np.array_equal(carrier.ahead(seen), seen)


def test_what_is_seen_corrects_what_is_commanded() -> None:
    body = resting_body()
    X_palm_box = transform((0.0, 0.0, 0.28))
    carrier = Carrier(body, "right", X_palm_box, CarryOptions(speed=0.01))
    off = transform((0.004, 0.0, 0.0))
    for _ in range(1500):
        lag = inverse(body.asked_palm("right") @ inverse(body.palm("right")))
        seen = lag @ carrier.X_world_box @ off
        carrier.step(seen)
    ahead = inverse(carrier.X_world_box) @ carrier.ahead(seen)
    assert np.allclose(ahead, off, atol=2e-4)


@pytest.mark.parametrize("bad", [{"speed": -0.1}, {"speed": 1.0}, {"turn_speed": 5.0}])
def test_speeds_out_of_range_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="allowed is"):
        CarryOptions(**bad)


def test_a_sweep_covers_every_place_the_box_is_led_to() -> None:
    options = CarryOptions(speed=0.05, turn_speed=0.35)
    poses, _ = swing(options, 8.0)
    ends = sweep(poses[0], options)
    for index in ((2, 3), (1, 0)):
        reached, covered = [X[index] for X in poses], [X[index] for X in ends]
        assert max(covered) >= max(reached) - 1e-3 and min(covered) <= min(reached) + 1e-3
        assert np.ptp(covered) <= 1.3 * np.ptp(reached), "and not much more"
    np.testing.assert_allclose(ends[0], ends[-1])
