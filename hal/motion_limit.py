"""One step of motion held within position, velocity and acceleration limits; arrays of any one length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preshape.hal.state import Vector


@dataclass(frozen=True, slots=True, eq=False)
class MotionLimits:
    """Limits of n joints: position rad, velocity rad/s, acceleration rad/s2."""

    lower: Vector
    upper: Vector
    velocity: Vector
    acceleration: Vector


class StepLimiter:
    """Clips requested positions to what the joints may do in one period; buffers are allocated once.

    With p, v the last position and velocity put out (v = (p_k - p_k-1) / dt) and the limits V and A,

        p_next in p + dt [max(-V, v - A dt), min(V, v + A dt)],  then in [min(lower, p), max(upper, p)].

    The position limits come last and win: at a limit the acceleration bound may give way. A joint that
    begins outside its limits may stay or return, never go farther out.
    """

    def __init__(self, limits: MotionLimits, period_s: float) -> None:
        self.limits = limits
        self._period = period_s
        self._speed_step = limits.velocity * period_s
        self._speed_change = limits.acceleration * period_s * period_s
        self._low, self._high = np.empty_like(limits.lower), np.empty_like(limits.lower)

    def clip(self, request: Vector, position: Vector, step: Vector, out: Vector) -> None:
        """Write the allowed position nearest to the request into out.

        `position` is the last output, `step` its last change (v dt); out may be none of the others.
        """
        low, high = self._low, self._high
        np.subtract(step, self._speed_change, out=low)
        np.maximum(low, -self._speed_step, out=low)
        np.add(low, position, out=low)
        np.add(step, self._speed_change, out=high)
        np.minimum(high, self._speed_step, out=high)
        np.add(high, position, out=high)
        np.maximum(request, low, out=out)
        np.minimum(out, high, out=out)
        np.minimum(self.limits.lower, position, out=low)
        np.maximum(self.limits.upper, position, out=high)
        np.maximum(out, low, out=out)
        np.minimum(out, high, out=out)

    def brake(self, position: Vector, step: Vector, out: Vector) -> None:
        """Write the next position of the hardest allowed deceleration towards rest into out."""
        np.abs(step, out=out)
        np.subtract(out, self._speed_change, out=out)
        np.maximum(out, 0.0, out=out)
        np.copysign(out, step, out=out)
        np.add(out, position, out=out)
        np.minimum(self.limits.lower, position, out=self._low)
        np.maximum(self.limits.upper, position, out=self._high)
        np.maximum(out, self._low, out=out)
        np.minimum(out, self._high, out=out)
