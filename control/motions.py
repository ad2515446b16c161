"""Motions as generators: each `next` is one tick, and the motion ends when the generator does."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence

import numpy as np
from numpy.typing import ArrayLike

from preshape.control.body import Body
from preshape.hal.layout import ARM_DOF, LAYOUT, SIDES, Side
from preshape.hal.transform import Matrix, exp_so3, length, log_so3, transform

Motion = Generator[None, None, None]


def eased(u: float) -> float:
    """Return 10 u^3 - 15 u^4 + 6 u^5: from 0 to 1 with zero speed and acceleration at both ends (peak slope 15/8)."""
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


def between(X_a: Matrix, X_b: Matrix, u: float) -> Matrix:
    """Return the pose a share u of the way from X_a to X_b: straight line and constant axis."""
    turn = log_so3(X_a[:3, :3].T @ X_b[:3, :3])
    return transform(X_a[:3, 3] + u * (X_b[:3, 3] - X_a[:3, 3]), X_a[:3, :3] @ exp_so3(u * turn))


def limited(vector: Matrix, most: float) -> Matrix:
    """Return a vector in its direction, no longer than `most` (in its unit)."""
    return vector * min(1.0, most / max(length(vector), 1e-12))


def ticks(body: Body, seconds: float) -> int:
    """Return how many periods a duration takes, at least one."""
    return max(1, round(seconds / body.period_s))


def wait(body: Body, seconds: float) -> Motion:
    """Do nothing new for a while."""
    for _ in range(ticks(body, seconds)):
        yield


def wait_for(body: Body, condition: Callable[[], bool], seconds: float) -> Generator[None, None, bool]:
    """Wait until a condition holds; return False if it did not within the time."""
    for _ in range(ticks(body, seconds)):
        if condition():
            return True
        yield
    return condition()


def gentle_seconds(points: Matrix, acceleration: float) -> float:
    """Return how long an eased leg must take so that no point on it accelerates more than given, m/s^2.

    `points` (n, k, 3), m: k carried points at n equal steps of the leg's share u of its way. With
    s = eased(t/T) the acceleration is (p'' s'^2 + p' s'') / T^2, sampled here by second differences.
    """
    n = len(points)
    at = np.array([eased(k / (n - 1)) for k in range(n)]) * (n - 1)
    low = np.minimum(at.astype(int), n - 2)
    share = (at - low)[:, None, None]
    moved = points[low] + share * (points[low + 1] - points[low])
    second = np.diff(moved, n=2, axis=0) * (n - 1) ** 2
    return float(np.sqrt(np.linalg.norm(second, axis=2).max() / acceleration))


def follow_arms(body: Body, waypoints: Matrix, speed: float = 0.35, least_s: Sequence[float] | None = None) -> Motion:
    """Lead both arms along joint way-points (n, 14), resting at each; `speed` is the share of the velocity limits.

    `least_s` (n - 1): the least time of each leg.
    """
    limits = np.concatenate([LAYOUT.velocity[LAYOUT.arm(side)] for side in SIDES])
    for leg, (start, end) in enumerate(zip(waypoints[:-1], waypoints[1:], strict=True)):
        seconds = 15.0 / 8.0 * float(np.max(np.abs(end - start) / limits)) / speed
        seconds = seconds if least_s is None else max(seconds, least_s[leg])
        count = ticks(body, seconds)
        for k in range(1, count + 1):
            q = start + eased(k / count) * (end - start)
            for number, side in enumerate(SIDES):
                own = slice(number * ARM_DOF, (number + 1) * ARM_DOF)
                if np.any(start[own] != end[own]):
                    body.ask_arm(side, q[own])
            yield


def lead_palm(
    body: Body, side: Side, X_world_palm: Matrix, speed: float = 0.10, turn_speed: float = 0.6, least_s: float = 0.2
) -> Motion:
    """Lead a palm on a straight line to a pose at a peak speed (m/s, rad/s)."""
    X_start = body.asked_palm(side)
    distance = length(X_world_palm[:3, 3] - X_start[:3, 3])
    turn = length(log_so3(X_start[:3, :3].T @ X_world_palm[:3, :3]))
    seconds = max(15.0 / 8.0 * max(distance / speed, turn / turn_speed), least_s)
    yield from lead_palm_for(body, side, X_world_palm, seconds)


def lead_palm_for(body: Body, side: Side, X_world_palm: Matrix, seconds: float) -> Motion:
    """Lead a palm on a straight line to a pose within a duration."""
    X_start = body.asked_palm(side)
    count = ticks(body, seconds)
    for k in range(1, count + 1):
        body.ask_palm(side, between(X_start, X_world_palm, eased(k / count)))
        yield


def lead_fingers(body: Body, side: Side, q: ArrayLike, speed: float = 1.2) -> Motion:
    """Move a hand's 13 joints together to angles (rad) at a peak joint speed (rad/s)."""
    start, end = body.asked_fingers(side), np.asarray(q, dtype=float)
    count = ticks(body, 15.0 / 8.0 * float(np.max(np.abs(end - start))) / speed)
    for k in range(1, count + 1):
        body.ask_fingers(side, start + eased(k / count) * (end - start))
        yield


def together(*motions: Motion) -> Motion:
    """Run motions side by side until all have ended."""
    running = list(motions)
    while running:
        alive: list[Motion] = []
        for motion in running:
            try:
                next(motion)
            except StopIteration:
                continue
            alive.append(motion)
        running = alive
        if running:
            yield
