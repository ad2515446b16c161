"""The simulated sensors: what noise, bias, delay and rate do, and nothing else."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.hal.transform import Matrix, exp_so3, log_so3, transform
from preshape.hal.world import CameraModel, PoseSample
from preshape.sim_backend.scenario import ObstacleSection, PerceptionSection, Scenario
from preshape.sim_backend.sensors import PoseSensor, SceneSensors, obstacle_pose

MS = 1_000_000
X_TRUE = transform((0.5, -0.3, 0.1), exp_so3([0.1, 0.2, 0.3]))
CAMERA = CameraModel(np.eye(4), 100.0, 64, 48)
CLEAN = PerceptionSection(noise_m=0.0, noise_deg=0.0, bias_m=0.0, bias_deg=0.0)


def samples(section: PerceptionSection, seed: int, seconds: float, start_ns: int = 0) -> list[PoseSample]:
    sensor = PoseSensor(section, seed, start_ns)
    found: list[PoseSample] = []
    for now in range(start_ns, start_ns + round(seconds * 1e9), MS):
        sensor.record(now, X_TRUE)
        sample = sensor.newest(now)
        if sample is not None and (not found or sample is not found[-1]):
            found.append(sample)
    return found


def deviations(found: list[PoseSample]) -> tuple[Matrix, Matrix]:
    shift = np.array([s.X_world_box[:3, 3] - X_TRUE[:3, 3] for s in found])
    return shift, np.array([log_so3(s.X_world_box[:3, :3] @ X_TRUE[:3, :3].T) for s in found])


def test_noise_is_white_of_the_stated_size_about_a_bias_of_the_stated_size() -> None:
    for seed in range(5):
        shift, turn = deviations(samples(PerceptionSection(), seed, 20.0))
        assert np.allclose(shift.std(axis=0), 0.002, rtol=0.15)
        assert np.allclose(turn.std(axis=0), np.deg2rad(2.0), rtol=0.15)
        assert abs(np.linalg.norm(shift.mean(axis=0)) - 0.002) < 0.0005
        assert abs(np.linalg.norm(turn.mean(axis=0)) - np.deg2rad(2.0)) < np.deg2rad(0.5)
        lagged = np.mean((shift[1:] - shift.mean(0)) * (shift[:-1] - shift.mean(0))) / shift.var()
        assert abs(lagged) < 0.1


def test_clean_sensor_reports_the_truth_late_and_at_its_rate() -> None:
    sensor = PoseSensor(CLEAN, 0)
    arrivals: list[tuple[int, int]] = []
    for now in range(0, 1000 * MS, MS):
        sensor.record(now, transform((now * 1e-9, 0.0, 0.0)))
        sample = sensor.newest(now)
        if sample is not None:
            assert sample.X_world_box[0, 3] == sample.stamp_ns * 1e-9
            if not arrivals or arrivals[-1][1] != sample.stamp_ns:
                arrivals.append((now, sample.stamp_ns))
    assert all(now - stamp == 40 * MS for now, stamp in arrivals)
    assert np.all(np.diff([stamp for _, stamp in arrivals]) == 20 * MS)
    assert len(arrivals) == 48


def test_a_seed_draws_the_same_samples_and_another_seed_others() -> None:
    a, b, c = (samples(PerceptionSection(), seed, 1.0) for seed in (4, 4, 5))
    assert all(np.array_equal(x.X_world_box, y.X_world_box) for x, y in zip(a, b, strict=True))
    assert not any(np.array_equal(x.X_world_box, y.X_world_box) for x, y in zip(a, c, strict=True))


def test_how_often_the_truth_is_recorded_or_read_changes_no_sample() -> None:
    dense, sparse = PoseSensor(PerceptionSection(), 1), PoseSensor(PerceptionSection(), 1)
    for now in range(0, 500 * MS, MS):
        dense.record(now, X_TRUE)
        dense.newest(now)
        if now % (20 * MS) == 0:
            sparse.record(now, X_TRUE)
    a, b = dense.newest(600 * MS), sparse.newest(600 * MS)
    assert a is not None and b is not None and a.stamp_ns == b.stamp_ns
    assert np.array_equal(a.X_world_box, b.X_world_box)


def test_startup_bias_ends_when_it_should() -> None:
    section = PerceptionSection(startup_bias_m=0.1, startup_s=1.0, noise_m=0.0, noise_deg=0.0, bias_m=0.0, bias_deg=0.0)
    start = 7_000_000_000
    for sample in samples(section, 3, 2.0, start):
        distance = float(np.linalg.norm(sample.X_world_box[:3, 3] - X_TRUE[:3, 3]))
        assert np.isclose(distance, 0.1 if sample.stamp_ns < start + 10**9 else 0.0, atol=1e-12)


def test_obstacles_appear_move_on_and_are_seen_late() -> None:
    moving = ObstacleSection(
        name="bar", size_m=(0.1, 0.2, 0.3), position_m=(0.5, 0.0, 0.4), appears_s=1.0, velocity_m_per_s=(0.0, 0.1, 0.0)
    )
    assert obstacle_pose(moving, 0.999, 1.0) is None and obstacle_pose(moving, 5.0, np.nan) is None
    appeared_s = np.array([np.nan])
    sensors = SceneSensors(Scenario(name="s", obstacles=(moving,)), CAMERA, no_image, appeared_s)
    assert sensors.obstacles(5000 * MS) == ()
    appeared_s[0] = 1.0
    assert sensors.obstacles(1030 * MS) == ()
    (seen,) = sensors.obstacles(3040 * MS)
    assert np.allclose(seen.X_world_box[:3, 3], [0.5, 0.2, 0.4]) and np.allclose(seen.half, [0.05, 0.1, 0.15])


def no_image(expected: Matrix | None) -> NDArray[np.uint8]:
    raise AssertionError("no image was asked for")


def test_image_is_taken_around_the_reported_pose_and_carries_its_time() -> None:
    asked: list[Matrix | None] = []

    def cast(expected: Matrix | None) -> NDArray[np.uint8]:
        asked.append(expected)
        return np.full((48, 64), 9, np.uint8)

    sensors = SceneSensors(Scenario(name="s"), CAMERA, cast, np.empty(0))
    first = sensors.image(5)
    sensors.record(10, X_TRUE)
    second = sensors.image(100 * MS)
    reported = sensors.object_pose(100 * MS)
    assert asked[0] is None and reported is not None and asked[1] is reported.X_world_box
    assert (first.stamp_ns, second.stamp_ns) == (5, 100 * MS) and second.model is CAMERA
    assert not np.array_equal(reported.X_world_box, X_TRUE)
