"""The box pose filter, fed by the simulated pose sensor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from preshape.control.object_filter import BoxEstimate, ObjectFilter, PalmHistory, interpolate_pose
from preshape.hal.transform import Matrix, exp_so3, inverse, log_so3, transform
from preshape.hal.world import PoseSample
from preshape.sim_backend.scenario import PerceptionSection
from preshape.sim_backend.sensors import PoseSensor

TICK = 2_000_000
X_REST = transform((0.55, -0.30, 0.10), exp_so3([0.0, 0.0, 0.4]))
X_PALM_BOX = transform((0.02, -0.01, 0.11), exp_so3([0.3, -0.2, 1.0]))
UNBIASED = PerceptionSection(bias_m=0.0, bias_deg=0.0)


def errors(estimate: BoxEstimate | None, X_world_box: Matrix) -> tuple[float, float]:
    assert estimate is not None
    X = estimate.X_world_box
    shift = float(np.linalg.norm(X[:3, 3] - X_world_box[:3, 3]))
    return shift, float(np.linalg.norm(log_so3(X[:3, :3] @ X_world_box[:3, :3].T)))


def moving_palm(time_s: float) -> Matrix:
    """A palm that translates at 0.05 m/s and turns at 20 deg/s."""
    turn = exp_so3(np.deg2rad(20.0) * time_s * np.array([0.6, 0.0, 0.8]))
    return transform(np.array([0.4, -0.1, 0.4]) + 0.05 * time_s * np.array([0.0, 0.8, 0.6]), turn)


def run(
    filter_: ObjectFilter,
    sensor: PoseSensor,
    truth: Callable[[float], Matrix],
    seconds: tuple[float, float],
    palm: Callable[[float], Matrix] | None = None,
) -> list[BoxEstimate]:
    """Tick sensor and filter at 500 Hz; return the estimate of every tick that has one."""
    estimates: list[BoxEstimate] = []
    for now in range(round(seconds[0] * 1e9), round(seconds[1] * 1e9), TICK):
        sensor.record(now, truth(now * 1e-9))
        if palm is not None:
            filter_.palm(now, palm(now * 1e-9))
        sample = sensor.newest(now)
        if sample is not None:
            filter_.observe(sample)
        estimate = filter_.estimate(now)
        if estimate is not None:
            estimates.append(estimate)
    return estimates


def test_says_nothing_before_the_first_sample() -> None:
    assert ObjectFilter().estimate(0) is None
    first = run(ObjectFilter(), PoseSensor(UNBIASED, 0), lambda _: X_REST, (0.0, 0.2))[0]
    assert first.time_ns >= 40_000_000 and not first.settled


def test_noise_on_a_resting_box_averages_away() -> None:
    for seed in range(10):
        last = run(ObjectFilter(), PoseSensor(UNBIASED, seed), lambda _: X_REST, (0.0, 2.0))[-1]
        shift, turn = errors(last, X_REST)
        assert last.settled and last.jumps == 0
        assert shift < 0.0013 and turn < np.deg2rad(1.3)
        assert 40_000_000 <= last.age_ns <= 62_000_000


def test_held_box_is_predicted_to_now_through_delay_and_motion() -> None:
    def truth(t: float) -> Matrix:
        return moving_palm(t) @ X_PALM_BOX

    for seed in range(10):
        filter_, sensor = ObjectFilter(), PoseSensor(UNBIASED, seed)
        run(filter_, sensor, lambda _: truth(0.0), (0.0, 1.0))
        filter_.hold(1_000_000_000, moving_palm(0.0))
        estimates = run(filter_, sensor, lambda t: truth(t - 1.0), (1.0, 4.0), lambda t: moving_palm(t - 1.0))
        for estimate in estimates[500:]:
            shift, turn = errors(estimate, truth(estimate.time_ns * 1e-9 - 1.0))
            assert shift < 0.002 and turn < np.deg2rad(2.0)
        assert estimates[-1].settled and estimates[-1].jumps == 0


def test_hold_and_release_leave_the_estimate_where_it_is() -> None:
    filter_, sensor = ObjectFilter(), PoseSensor(UNBIASED, 1)
    before = run(filter_, sensor, lambda _: X_REST, (0.0, 1.0))[-1]
    filter_.hold(before.time_ns, moving_palm(0.3))
    held = filter_.estimate(before.time_ns)
    filter_.release(before.time_ns)
    released = filter_.estimate(before.time_ns)
    assert held is not None and released is not None
    assert np.allclose(held.X_world_box, before.X_world_box) and np.allclose(released.X_world_box, before.X_world_box)


def test_startup_bias_of_100_mm_is_left_behind_by_one_jump() -> None:
    for seed in range(10):
        section = PerceptionSection(startup_bias_m=0.1, startup_s=1.0)
        filter_ = ObjectFilter()
        estimates = run(filter_, PoseSensor(section, seed), lambda _: X_REST, (0.0, 3.0))
        assert estimates[-1].jumps == 1 and estimates[-1].settled
        assert errors(estimates[-1], X_REST)[0] < 0.0035
        doubting = [e for e in estimates if 1.10 < e.time_ns * 1e-9 < 1.18]
        assert doubting and not any(e.settled for e in doubting)
        assert errors(next(e for e in estimates if e.time_ns > 1_300_000_000), X_REST)[0] < 0.006


def test_lone_outliers_change_nothing() -> None:
    rng = np.random.default_rng(7)
    filter_, sensor = ObjectFilter(), PoseSensor(UNBIASED, 2)
    run(filter_, sensor, lambda _: X_REST, (0.0, 1.0))
    for number in range(100):
        before = filter_.estimate(1_000_000_000)
        wrong = transform(X_REST[:3, 3] + rng.uniform(0.05, 0.5, 3), exp_so3(rng.standard_normal(3)) @ X_REST[:3, :3])
        filter_.observe(PoseSample(1_000_000_000 + 20_000_000 * number, wrong))
        after = filter_.estimate(1_000_000_000)
        assert before is not None and after is not None
        assert np.array_equal(before.X_world_box, after.X_world_box) and after.jumps == 0
        assert number < 2 or not after.settled


def test_old_repeated_and_not_finite_samples_are_ignored() -> None:
    filter_ = ObjectFilter()
    filter_.observe(PoseSample(1000, X_REST))
    for stamp, X in ((1000, transform((1.0, 0.0, 0.0))), (900, X_REST @ X_PALM_BOX), (2000, np.full((4, 4), np.nan))):
        filter_.observe(PoseSample(stamp, X))
    estimate = filter_.estimate(2000)
    assert estimate is not None and estimate.stamp_ns == 1000
    assert np.array_equal(estimate.X_world_box, X_REST)


def test_slow_push_is_followed() -> None:
    def truth(t: float) -> Matrix:
        X = X_REST.copy()
        X[0, 3] += 0.03 * float(np.clip(t - 2.0, 0.0, 1.0))
        return X

    for seed in range(10):
        estimates = run(ObjectFilter(), PoseSensor(UNBIASED, seed), truth, (0.0, 4.0))
        lag = [errors(e, truth(e.time_ns * 1e-9))[0] for e in estimates if 2.0 < e.time_ns * 1e-9 < 3.5]
        assert max(lag) < 0.012
        assert errors(estimates[-1], truth(4.0))[0] < 0.002


def test_silence_unsettles_the_estimate() -> None:
    filter_ = ObjectFilter()
    last = run(filter_, PoseSensor(UNBIASED, 3), lambda _: X_REST, (0.0, 1.0))[-1]
    later = filter_.estimate(last.time_ns + 300_000_000)
    assert last.settled and later is not None and not later.settled and later.age_ns > 300_000_000


def test_correction_from_an_image_cancels_the_bias_also_after_the_box_has_moved() -> None:
    def truth(t: float) -> Matrix:
        return moving_palm(max(0.0, t - 1.5)) @ X_PALM_BOX

    def palm(t: float) -> Matrix:
        return moving_palm(max(0.0, t - 1.5))

    corrected, biased = [], []
    for seed in range(10):
        for correct, out in ((True, corrected), (False, biased)):
            filter_, sensor = ObjectFilter(), PoseSensor(PerceptionSection(), seed)
            filter_.hold(0, palm(0.0))
            run(filter_, sensor, truth, (0.0, 1.5), palm)
            if correct:
                assert filter_.correct(1_490_000_000, truth(1.49))
            out.append(errors(run(filter_, sensor, truth, (1.5, 5.0), palm)[-1], truth(5.0)))
    assert np.all(np.median(corrected, axis=0) < 0.4 * np.median(biased, axis=0))


def test_correction_too_large_for_a_bias_is_refused() -> None:
    filter_ = ObjectFilter()
    assert not filter_.correct(0, X_REST)
    last = run(filter_, PoseSensor(UNBIASED, 3), lambda _: X_REST, (0.0, 1.0))[-1]
    assert not filter_.correct(last.time_ns, X_REST @ transform((0.05, 0.0, 0.0)))
    assert not filter_.correct(last.time_ns, np.full((4, 4), np.nan))
    now = filter_.estimate(last.time_ns)
    assert now is not None and np.array_equal(now.X_world_box, last.X_world_box)


def test_palm_without_hold_is_a_caller_s_mistake() -> None:
    with pytest.raises(RuntimeError, match="not held"):
        ObjectFilter().palm(0, np.eye(4))


def test_palm_history_interpolates_between_its_poses_and_forgets_the_oldest() -> None:
    history = PalmHistory(100_000_000)
    assert history.at(0) is None
    for tick in range(500):
        history.add(tick * TICK, moving_palm(tick * TICK * 1e-9))
    time = 480 * TICK + 700_000
    between, newest = history.at(time), history.at(10**12)
    assert between is not None and newest is not None
    assert np.allclose(between, moving_palm(time * 1e-9), atol=1e-6)
    assert np.array_equal(newest, moving_palm(499 * TICK * 1e-9))
    assert history.at(TICK) is None


def test_interpolation_meets_both_ends_and_is_a_constant_turn() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        X_a, X_b = (transform(rng.standard_normal(3), exp_so3(rng.standard_normal(3))) for _ in range(2))
        assert np.allclose(interpolate_pose(X_a, X_b, 0.0), X_a)
        assert np.allclose(interpolate_pose(X_a, X_b, 1.0), X_b)
        X_m = interpolate_pose(X_a, X_b, 0.5)
        halves = [inverse(X_a)[:3, :3] @ X_m[:3, :3], inverse(X_m)[:3, :3] @ X_b[:3, :3]]
        assert np.allclose(halves[0], halves[1])
