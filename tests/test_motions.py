"""Laws of motions as generators, on a body whose measured joints follow every request at once."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from preshape.control.body import Body
from preshape.control.motions import (
    between,
    eased,
    follow_arms,
    gentle_seconds,
    lead_fingers,
    lead_palm,
    ticks,
    together,
    wait,
    wait_for,
)
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.transform import Matrix, exp_so3, log_so3, transform
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import workcell

PERIOD_S = 0.002
START = 0.5 * (LAYOUT.lower + LAYOUT.upper)
ARM_SPEED = np.concatenate([LAYOUT.velocity[LAYOUT.arm(side)] for side in SIDES])


def still_body() -> Body:
    body = Body(workcell(Scenario(name="cell")), PERIOD_S)
    body.follow(START, np.zeros(LAYOUT.dof))
    return body


def random_pose(rng: np.random.Generator) -> Matrix:
    axis = rng.normal(size=3)
    return transform(rng.uniform(-1, 1, 3), exp_so3(axis / np.linalg.norm(axis) * rng.uniform(0, 3.0)))


def test_eased_starts_and_ends_at_rest_and_never_goes_back() -> None:
    u = np.linspace(0.0, 1.0, 10_001)
    s = np.array([eased(x) for x in u])
    speed, h = np.gradient(s, u), u[1]
    assert (s[0], s[-1]) == (0.0, 1.0)
    assert np.diff(s).min() >= 0.0
    assert abs(speed.max() - 15.0 / 8.0) < 1e-6
    for end in (slice(0, 3), slice(-3, None)):
        assert abs(np.diff(s[end], n=1) / h).max() < 1e-6
        assert abs(np.diff(s[end], n=2) / h**2).max() < 0.01
    assert abs(np.diff(s, n=2) / h**2).max() > 5.0


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
def test_between_goes_straight_about_one_axis_and_meets_both_ends(seed: int, u: float) -> None:
    rng = np.random.default_rng(seed)
    X_a, X_b = random_pose(rng), random_pose(rng)
    np.testing.assert_allclose(between(X_a, X_b, 0.0), X_a, atol=1e-12)
    np.testing.assert_allclose(between(X_a, X_b, 1.0), X_b, atol=1e-7)
    X = between(X_a, X_b, u)
    np.testing.assert_allclose(X[:3, 3], (1 - u) * X_a[:3, 3] + u * X_b[:3, 3], atol=1e-12)
    whole = log_so3(X_a[:3, :3].T @ X_b[:3, :3])
    np.testing.assert_allclose(log_so3(X_a[:3, :3].T @ X[:3, :3]), u * whole, atol=1e-6)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 1.0))
def test_follow_arms_keeps_the_share_of_the_speed_limits_and_rests_at_each_waypoint(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    body = still_body()
    waypoints = body.asked_arms() + np.vstack([np.zeros(14), np.cumsum(rng.uniform(-0.3, 0.3, (3, 14)), axis=0)])
    asked = [body.asked_arms()]
    for _ in follow_arms(body, waypoints, share):
        asked.append(body.asked_arms())
    speed = np.abs(np.diff(asked, axis=0)) / PERIOD_S / ARM_SPEED
    exact = 15.0 / 8.0 * (np.abs(np.diff(waypoints, axis=0)) / ARM_SPEED).max(axis=1) / share / PERIOD_S
    # The count of ticks is rounded: a leg may be half a tick short.
    assert 0.98 * share < speed.max() <= share * (1.0 + 0.5 / (exact.min() - 0.5))
    for waypoint in waypoints:
        assert np.abs(np.array(asked) - waypoint).max(axis=1).min() < 1e-12
    np.testing.assert_allclose(asked[-1], waypoints[-1], atol=1e-12)


def test_follow_arms_leaves_an_arm_alone_that_has_nowhere_to_go() -> None:
    body = still_body()
    X_left = body.asked_palm("left")
    body.ask_palm("left", X_left)
    end = body.asked_arms()
    end[:7] += 0.1
    for _ in follow_arms(body, np.array([body.asked_arms(), end])):
        assert body.asked_palm("left") is X_left


def test_follow_arms_takes_at_least_the_time_asked_for() -> None:
    body = still_body()
    start = body.asked_arms()
    waypoints = np.array([start, start + 0.01, start])
    assert len(list(follow_arms(body, waypoints, 0.5, [0.7, 0.3]))) == round(1.0 / PERIOD_S)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 2.0))
def test_a_leg_of_gentle_seconds_stays_below_its_acceleration_and_is_not_needlessly_slow(
    seed: int, bound: float
) -> None:
    rng = np.random.default_rng(seed)
    coefficients = rng.uniform(-0.3, 0.3, (4, 2, 3))

    def place(u: Matrix) -> Matrix:
        return sum(c * u[:, None, None] ** k for k, c in enumerate(coefficients))

    seconds = gentle_seconds(place(np.linspace(0.0, 1.0, 41)), bound)
    t = np.linspace(0.0, 1.0, 2_001)
    path = place(np.array([eased(x) for x in t]))
    acceleration = np.linalg.norm(np.diff(path, n=2, axis=0) / (t[1] * seconds) ** 2, axis=2).max()
    # 41 samples joined by straight lines: the law holds but for the corners.
    assert 0.6 * bound < acceleration < 1.15 * bound


def test_lead_palm_ends_at_the_pose_and_keeps_its_peak_speeds() -> None:
    body = still_body()
    X_goal = body.asked_palm("right") @ transform((0.05, -0.02, 0.03), exp_so3(np.array([0.2, 0.1, -0.1])))
    poses = [body.asked_palm("right").copy()]
    for _ in lead_palm(body, "right", X_goal, speed=0.10, turn_speed=0.6):
        poses.append(body.asked_palm("right").copy())
    np.testing.assert_allclose(poses[-1], X_goal, atol=1e-7)
    moved = np.linalg.norm(np.diff([X[:3, 3] for X in poses], axis=0), axis=1) / PERIOD_S
    turned = [
        np.linalg.norm(log_so3(A[:3, :3].T @ B[:3, :3])) / PERIOD_S for A, B in zip(poses, poses[1:], strict=False)
    ]
    assert moved.max() < 0.101 and max(turned) < 0.606
    assert max(moved.max() / 0.10, max(turned) / 0.6) > 0.98


def test_lead_fingers_reaches_its_angles_no_faster_than_asked() -> None:
    body = still_body()
    goal = body.asked_fingers("left") + np.linspace(-0.1, 0.1, 13)
    asked = [body.asked_fingers("left")]
    for _ in lead_fingers(body, "left", goal, speed=0.5):
        asked.append(body.asked_fingers("left"))
    np.testing.assert_allclose(asked[-1], goal, atol=1e-12)
    assert 0.45 < np.abs(np.diff(asked, axis=0)).max() / PERIOD_S < 0.505


def test_together_lasts_as_long_as_its_longest_and_advances_all_in_one_tick() -> None:
    seen: list[str] = []

    def motion(name: str, count: int) -> Iterator[None]:
        for _ in range(count):
            seen.append(name)
            yield

    assert len(list(together(motion("a", 2), motion("b", 4)))) == 4
    assert seen == ["a", "b", "a", "b", "b", "b"]


def test_waiting_takes_its_time_at_least_one_tick_and_says_whether_the_condition_came() -> None:
    body = still_body()
    assert len(list(wait(body, 0.1))) == ticks(body, 0.1) == 50
    assert ticks(body, 0.0) == 1

    def outcome(due: int) -> tuple[int, bool]:
        count = 0
        motion = wait_for(body, lambda: count >= due, 0.02)
        while True:
            try:
                next(motion)
            except StopIteration as stop:
                return count, stop.value
            count += 1

    assert outcome(3) == (3, True)
    assert outcome(10) == (10, True)
    assert outcome(11) == (10, False)
