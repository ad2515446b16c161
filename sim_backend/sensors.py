"""The scene's sensors: simulator truth with noise, bias, rate and delay on it, and the camera's images."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, exp_so3, rpy_matrix, transform
from preshape.hal.world import CameraModel, Image, OrientedBox, PoseSample
from preshape.sim_backend.scenario import ObstacleSection, PerceptionSection, Scenario

Cast = Callable[[Matrix | None], NDArray[np.uint8]]
"""Takes the image of this moment; given the box's expected pose, it may read out a window around it only."""


def obstacle_pose(obstacle: ObstacleSection, time_s: float, appeared_s: float) -> Matrix | None:
    """Return X_world_obstacle at a time since the start, None before it appeared (NaN: not yet); it moves from then."""
    if not time_s >= appeared_s:
        return None
    p = np.array(obstacle.position_m) + np.array(obstacle.velocity_m_per_s) * (time_s - appeared_s)
    return transform(p, rpy_matrix((0.0, 0.0, np.deg2rad(obstacle.yaw_deg))))


class PoseSensor:
    """Samples the box's pose at its rate and hands each sample out after the delay.

    p' = p + bias + startup + noise, R' = exp(bias + noise) R, all in the world's frame. Noise is normal per axis with
    the section's standard deviation; the bias has the section's size and a direction drawn per seed; so does the
    start-up bias, which ends at `startup_s`.
    """

    def __init__(self, section: PerceptionSection, seed: int, start_ns: int = 0) -> None:
        """Draw the biases; times count from `start_ns`."""
        self._section = section
        self._rng = np.random.default_rng((0x9E6C, seed))
        directions = self._rng.standard_normal((3, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        self._bias = directions[0] * section.bias_m
        self._turn_bias = directions[1] * np.deg2rad(section.bias_deg)
        self._startup_bias = directions[2] * section.startup_bias_m
        self._start_ns = start_ns
        self._period_ns = round(1e9 / section.rate_hz)
        self._delay_ns = round(section.delay_s * 1e9)
        self._next_ns = start_ns
        self._queue: deque[PoseSample] = deque()
        self._arrived: PoseSample | None = None

    def record(self, time_ns: int, X_world_box: Matrix) -> None:
        """Take the true pose at a time; keeps a sample whenever one is due. Times must not go back."""
        if time_ns < self._next_ns:
            return
        self._next_ns += self._period_ns * (1 + (time_ns - self._next_ns) // self._period_ns)
        self._queue.append(PoseSample(time_ns, self._measured(time_ns, X_world_box)))

    def newest(self, now_ns: int) -> PoseSample | None:
        """Return the newest sample that is at least as old as the delay, None before the first."""
        while self._queue and self._queue[0].stamp_ns + self._delay_ns <= now_ns:
            self._arrived = self._queue.popleft()
        return self._arrived

    def _measured(self, time_ns: int, X_world_box: Matrix) -> Matrix:
        section = self._section
        noise, turn = self._rng.standard_normal((2, 3))
        p = X_world_box[:3, 3] + self._bias + section.noise_m * noise
        if time_ns - self._start_ns < section.startup_s * 1e9:
            p = p + self._startup_bias
        return transform(p, exp_so3(self._turn_bias + np.deg2rad(section.noise_deg) * turn) @ X_world_box[:3, :3])


class SceneSensors:
    """`preshape.hal.world.Perception` of a simulated scene; the simulator calls `record` at every step."""

    def __init__(
        self, scenario: Scenario, camera: CameraModel, cast: Cast, appeared_s: Vector, start_ns: int = 0
    ) -> None:
        """Set up the sensors of a drawn scenario; `cast` takes images, and times count from `start_ns`.

        `appeared_s` (obstacles,) is when each obstacle appeared, s since the start, NaN: not yet; whoever knows keeps
        it up to date.
        """
        self._pose = PoseSensor(scenario.perception, scenario.seed, start_ns)
        self._obstacles = scenario.obstacles
        self._appeared_s = appeared_s
        self._delay_ns = round(scenario.perception.delay_s * 1e9)
        self._camera = camera
        self._cast = cast
        self._start_ns = start_ns

    def record(self, time_ns: int, X_world_box: Matrix) -> None:
        """Take the box's true pose at a time."""
        self._pose.record(time_ns, X_world_box)

    def object_pose(self, now_ns: int) -> PoseSample | None:
        """Return the newest pose sample that has arrived."""
        return self._pose.newest(now_ns)

    def obstacles(self, now_ns: int) -> tuple[OrientedBox, ...]:
        """Return the scenario's obstacles as they were one delay ago."""
        time_s = (now_ns - self._delay_ns - self._start_ns) * 1e-9
        poses = [
            (obstacle, obstacle_pose(obstacle, time_s, float(appeared_s)))
            for obstacle, appeared_s in zip(self._obstacles, self._appeared_s, strict=True)
        ]
        return tuple(
            OrientedBox(f"obstacle_{obstacle.name}", X, np.array(obstacle.size_m) / 2)
            for obstacle, X in poses
            if X is not None
        )

    def image(self, now_ns: int) -> Image:
        """Take an image, read out around where the last pose sample puts the box (all of it before the first)."""
        sample = self._pose.newest(now_ns)
        return Image(now_ns, self._cast(None if sample is None else sample.X_world_box), self._camera)
