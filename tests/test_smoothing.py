"""Laws of the smoothing: commands are continuous, bounded and come to rest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from preshape.control.smoothing import SmoothConfig, Smoother, SmoothStatus
from preshape.control.tracking import stopping_speed
from preshape.hal.layout import LAYOUT

DT = SmoothConfig().period_s
MIDDLE = 0.5 * (LAYOUT.lower + LAYOUT.upper)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), spread=st.floats(0.01, 2.0))
def test_commands_stay_inside_position_velocity_acceleration_and_jerk_limits(seed: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    smoother = Smoother()
    smoother.seed(rng.uniform(LAYOUT.lower, LAYOUT.upper))
    last = smoother.brake()
    target, speed = last.position, np.zeros(LAYOUT.dof)
    for tick in range(120):
        if tick % 13 == 0:
            target = rng.uniform(LAYOUT.lower - 0.2, LAYOUT.upper + 0.2)
            target = last.position + spread * (target - last.position)
            speed = rng.uniform(-1.5, 1.5, LAYOUT.dof) * LAYOUT.velocity
        step = smoother.update(target, speed if tick % 2 else None)
        assert (step.position >= LAYOUT.lower).all() and (step.position <= LAYOUT.upper).all()
        assert (np.abs(step.velocity) <= smoother.velocity_limit + 1e-9).all()
        assert (np.abs(step.acceleration) <= smoother.acceleration_limit + 1e-9).all()
        held = (step.velocity == 0.0) & (step.acceleration == 0.0)
        jerk = np.abs(step.acceleration - last.acceleration) / DT
        assert ((jerk <= smoother.jerk_limit * (1 + 1e-6)) | held).all()
        moved = np.abs(step.position - last.position)
        assert (moved <= smoother.velocity_limit * DT + 1e-9).all()
        last = step


def test_position_limits_are_kept_without_clamping_from_rest() -> None:
    rng = np.random.default_rng(0)
    smoother = Smoother()
    smoother.seed(rng.uniform(LAYOUT.lower, LAYOUT.upper))
    for tick in range(2000):
        if tick % 50 == 0:
            target = rng.uniform(LAYOUT.lower - 0.3, LAYOUT.upper + 0.3)
        smoother.update(target)
    assert smoother.clamped == 0


def test_a_target_is_reached_exactly_and_held() -> None:
    smoother = Smoother()
    target = MIDDLE + 0.1
    steps = [smoother.update(target) for _ in range(1000)]
    assert steps[-1].status is SmoothStatus.REACHED
    assert np.allclose(steps[-1].position, target, atol=1e-9)
    assert np.allclose(steps[-1].velocity, 0.0, atol=1e-9)


def test_a_joint_does_not_wait_for_another() -> None:
    alone, together = Smoother(), Smoother()
    for smoother in (alone, together):
        smoother.seed(MIDDLE)
    finger, arm = LAYOUT.index("right_fore_flex"), LAYOUT.index("right_arm_1")
    near = MIDDLE.copy()
    near[finger] += 0.2
    far = near.copy()
    far[arm] += 2.0
    for _ in range(100):
        assert alone.update(near).position[finger] == together.update(far).position[finger]


def test_braking_comes_to_rest_in_the_least_time_from_any_motion() -> None:
    smoother = Smoother()
    smoother.seed(MIDDLE)
    for _ in range(60):
        smoother.update(LAYOUT.upper)
    v, a = np.abs(smoother.velocity), smoother.acceleration_limit
    bound = v / a + 3.0 * a / smoother.jerk_limit + 2 * DT
    for _ in range(int(np.ceil(bound.max() / DT))):
        step = smoother.brake()
    assert step.status is SmoothStatus.REACHED
    assert not step.velocity.any() or np.abs(step.velocity).max() < 1e-9


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_target_that_is_not_finite_brakes_instead_of_moving(value: float) -> None:
    smoother = Smoother()
    smoother.seed(MIDDLE)
    for _ in range(50):
        smoother.update(MIDDLE + 0.5)
    target = MIDDLE.copy()
    target[5] = value
    speeds = []
    for _ in range(400):
        step = smoother.update(target)
        assert step.status is SmoothStatus.BAD_TARGET
        speeds.append(np.abs(step.velocity).max())
    assert speeds[-1] < 1e-9 and np.isfinite(step.position).all()


def test_a_seed_above_the_speed_limit_is_cut_and_still_computed() -> None:
    smoother = Smoother()
    smoother.seed(MIDDLE, 3.0 * LAYOUT.velocity)
    assert smoother.update(MIDDLE + 0.01).status is SmoothStatus.MOVING


def test_a_joint_seeded_outside_its_limits_returns_without_a_jump() -> None:
    smoother = Smoother()
    start = MIDDLE.copy()
    start[8] = LAYOUT.upper[8] + 0.05
    smoother.seed(start)
    last = start
    for _ in range(500):
        step = smoother.update(MIDDLE)
        assert np.abs(step.position - last).max() <= (LAYOUT.velocity * DT).max()
        assert step.position[8] <= start[8] + 1e-12
        last = step.position
    assert np.allclose(last, MIDDLE, atol=1e-6)


def test_stopping_speed_stops_within_its_distance() -> None:
    distance = np.geomspace(1e-6, 2.0, LAYOUT.dof)
    v = np.array([stopping_speed(*of) for of in zip(distance, LAYOUT.acceleration, LAYOUT.jerk, strict=True)])
    ramp = LAYOUT.acceleration**2 / LAYOUT.jerk
    long_way = v**2 / (2 * LAYOUT.acceleration) + v * LAYOUT.acceleration / (2 * LAYOUT.jerk)
    needed = np.where(v >= ramp, long_way, v**1.5 / np.sqrt(LAYOUT.jerk))
    assert (needed <= distance * (1 + 1e-9)).all()


@pytest.mark.parametrize("bad", [np.zeros(39), np.zeros((40, 1)), 0.0])
def test_targets_and_seeds_of_another_shape_are_the_callers_mistake(bad: np.ndarray) -> None:
    smoother = Smoother()
    for call in (smoother.update, smoother.seed, lambda x: smoother.update(MIDDLE, x)):
        with pytest.raises(ValueError, match="shape"):
            call(bad)


@pytest.mark.parametrize("changes", [{"period_s": 0.0}, {"velocity_ratio": 1.2}, {"jerk_ratio": -1.0}])
def test_settings_out_of_range_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="allowed is"):
        SmoothConfig(**changes)


def test_tracked_joints_follow_a_slowing_target_without_ever_turning_back() -> None:
    smoother = Smoother()
    smoother.seed(MIDDLE)
    tracked = np.ones(LAYOUT.dof, dtype=bool)
    amplitude = 0.3 * np.minimum(LAYOUT.upper - MIDDLE, 0.5)
    seconds = 2.0
    last, worst = MIDDLE, 0.0
    count = round(seconds / DT)
    for k in range(1, count + 1):
        u = k / count
        goal = MIDDLE + amplitude * u * u * (3.0 - 2.0 * u)
        ahead = MIDDLE + amplitude * (lambda w: w * w * (3.0 - 2.0 * w))((k - 1) / count)
        step = smoother.update(goal, (goal - ahead) / DT, tracked)
        assert (step.position >= last - 2e-5).all()
        worst = max(worst, float(np.abs(step.position - goal).max()))
        last = step.position
    assert worst < 5e-3
    for _ in range(300):
        step = smoother.update(MIDDLE + amplitude, np.zeros(LAYOUT.dof), tracked)
    assert np.allclose(step.position, MIDDLE + amplitude, atol=1e-4)


def test_tracked_joints_keep_their_limits_whatever_the_target_does() -> None:
    rng = np.random.default_rng(3)
    smoother = Smoother()
    smoother.seed(MIDDLE)
    tracked = rng.uniform(size=LAYOUT.dof) < 0.5
    last = smoother.brake()
    for tick in range(1500):
        if tick % 40 == 0:
            target = rng.uniform(LAYOUT.lower - 0.5, LAYOUT.upper + 0.5)
            speed = rng.uniform(-3.0, 3.0, LAYOUT.dof)
        step = smoother.update(target, speed, tracked)
        assert (step.position >= LAYOUT.lower - 1e-9).all() and (step.position <= LAYOUT.upper + 1e-9).all()
        assert (np.abs(step.velocity) <= smoother.velocity_limit + 1e-9).all()
        assert (np.abs(step.acceleration) <= smoother.acceleration_limit + 1e-9).all()
        last = step
    assert last.status is not SmoothStatus.FAILED
