"""How fast a joint may follow a moving target so that it can still stop, and what keeps it inside its limits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from preshape.hal.compiled import compiled
from preshape.hal.state import Vector

TRACKING_GAIN = 40.0
"""Speed per distance from a tracked target, 1/s."""
ROUNDING = 1e-9
"""A position this little (rad) outside its limits is put back without a stop."""


@compiled
def stopping_speed(distance: float, acceleration: float, jerk: float) -> float:
    """Return the largest speed from which a joint, at rest in acceleration, stops within a distance (>= 0).

    Stopping takes v^2/(2A) + v A/(2J) when v >= A^2/J and v^(3/2)/sqrt(J) below; the first is never less
    than the second, so v = -A^2/(2J) + sqrt((A^2/(2J))^2 + 2 A d) is safe for both.
    """
    ramp = acceleration * acceleration / (2.0 * jerk)
    return math.sqrt(ramp * ramp + 2.0 * acceleration * distance) - ramp


@compiled
def lead(
    target: Vector, speed: Vector, tracked: NDArray[np.bool_], position: Vector, lower: Vector, upper: Vector,
    velocity: Vector, acceleration: Vector, jerk: Vector, goal: Vector, pace: Vector,
) -> bool:  # fmt: skip
    """Write each joint's target within its limits into `goal` and its target speed into `pace`; False if not finite.

    The speed of a joint that is `tracked` is that of its target plus `TRACKING_GAIN` times what is left, cut so that
    it can stop at the target and within its limits; it is 0 for the others.
    """
    for j in range(len(target)):
        if not (math.isfinite(target[j]) and math.isfinite(speed[j])):
            return False
        goal[j] = min(max(target[j], lower[j]), upper[j])
        pace[j] = 0.0
        if not tracked[j]:
            continue
        left = goal[j] - position[j]
        most = min(TRACKING_GAIN * abs(left), stopping_speed(abs(left), acceleration[j], jerk[j]))
        wanted = speed[j] + (most if left > 0.0 else -most)
        room = upper[j] - position[j] if wanted > 0.0 else position[j] - lower[j]
        top = min(stopping_speed(max(room, 0.0), acceleration[j], jerk[j]), velocity[j])
        pace[j] = min(max(wanted, -top), top)
    return True


@compiled
def put_back(
    position: Vector, velocity: Vector, acceleration: Vector, before: Vector, lower: Vector, upper: Vector
) -> tuple[bool, int]:
    """Stop joints, in place, that were carried farther outside their limits than `before`.

    Returns whether any position was changed, and how many joints were by more than `ROUNDING`.
    """
    moved, stopped = False, 0
    for j in range(len(position)):
        held = min(max(position[j], min(lower[j], before[j])), max(upper[j], before[j]))
        if held == position[j]:
            continue
        moved = True
        if abs(held - position[j]) > ROUNDING:
            velocity[j] = acceleration[j] = 0.0
            stopped += 1
        position[j] = held
    return moved, stopped
