"""Commands of bounded velocity, acceleration and jerk for all 40 joints (ruckig), one period at a time.

Every joint is on its own clock (`Synchronization.No`): a finger that closes does not wait for an arm.
Each period starts from the last command, never from a measurement, so commands are continuous.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import ruckig as untyped_ruckig
from numpy.typing import ArrayLike, NDArray

from preshape.control.tracking import lead, put_back
from preshape.hal.layout import LAYOUT
from preshape.hal.state import Vector

ruckig: Any = untyped_ruckig  # its extension module has no types

Flags = NDArray[np.bool_]
_NONE: Flags = np.zeros(LAYOUT.dof, dtype=np.bool_)
_ALL: Flags = np.ones(LAYOUT.dof, dtype=np.bool_)
_STILL = np.zeros(LAYOUT.dof)


class SmoothStatus(IntEnum):
    """What a period was used for: towards the target, braking after a bad target, or nothing could be computed."""

    MOVING = 0
    REACHED = 1
    BAD_TARGET = 2
    FAILED = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class SmoothConfig:
    """Shares of the joints' own limits that commands may use, and the period, s.

    The safety gate cuts at the full limits: what stays below never meets it.
    """

    period_s: float = 0.002
    velocity_ratio: float = 0.95
    acceleration_ratio: float = 0.95
    jerk_ratio: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.period_s <= 0.1:
            raise ValueError(f"period_s: got {self.period_s}, allowed is 0 .. 0.1")
        for name in ("velocity_ratio", "acceleration_ratio", "jerk_ratio"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise ValueError(f"{name}: got {getattr(self, name)}, allowed is 0 .. 1")


@dataclass(frozen=True, slots=True, eq=False)
class SmoothStep:
    """The command after one period: position rad, velocity rad/s, acceleration rad/s2, each (40,)."""

    status: SmoothStatus
    position: Vector
    velocity: Vector
    acceleration: Vector


class Smoother:
    """Ruckig with what it does not check itself: lengths, finite values, position limits, current velocity."""

    def __init__(self, config: SmoothConfig | None = None) -> None:
        self.config = config or SmoothConfig()
        self.velocity_limit = LAYOUT.velocity * self.config.velocity_ratio
        self.acceleration_limit = LAYOUT.acceleration * self.config.acceleration_ratio
        self.jerk_limit = LAYOUT.jerk * self.config.jerk_ratio
        self._ruckig = ruckig.Ruckig(LAYOUT.dof, self.config.period_s)
        self._input: Any = ruckig.InputParameter(LAYOUT.dof)
        self._output: Any = ruckig.OutputParameter(LAYOUT.dof)
        self._input.synchronization = ruckig.Synchronization.No
        self._input.max_velocity = self.velocity_limit.tolist()
        self._input.max_acceleration = self.acceleration_limit.tolist()
        self._input.max_jerk = self.jerk_limit.tolist()
        self._zeros = [0.0] * LAYOUT.dof
        self._led = b""
        self._is_fed = False
        self.clamped = 0
        self.seed(0.5 * (LAYOUT.lower + LAYOUT.upper))

    def seed(
        self, position: ArrayLike, velocity: ArrayLike | None = None, acceleration: ArrayLike | None = None
    ) -> None:
        """Continue from a command: position (40,), rad, velocity, rad/s, and acceleration, rad/s2; at rest by default.

        What is above its limit is cut to it. `ValueError` for another shape or values that are not finite.
        """
        position = _checked(position, "position")
        speed = _STILL if velocity is None else _checked(velocity, "velocity")
        change = _STILL if acceleration is None else _checked(acceleration, "acceleration")
        self.position = position
        self.velocity = np.clip(speed, -self.velocity_limit, self.velocity_limit)
        self.acceleration = np.clip(change, -self.acceleration_limit, self.acceleration_limit)
        self._is_fed = False

    def update(
        self,
        target_position: ArrayLike,
        target_velocity: ArrayLike | None = None,
        tracked: NDArray[np.bool_] | None = None,
    ) -> SmoothStep:
        """Return the command one period on, towards a target position (40,), rad.

        Joints marked in `tracked` (40,) follow a target that moves at `target_velocity` (40,), rad/s: their speed is
        that of the target plus `TRACKING_GAIN` times what is left, cut so that they can stop at the target and
        within their limits. The others come to rest at the target in the least time. (To meet a moving target in
        the least time is no way to track it: once ahead of it by a hair, the quickest way to its position *and*
        speed is to brake, go back and start again.) Targets outside the position limits are moved to them; a target
        that is not finite brakes: BAD_TARGET.

        Raises:
            ValueError: a target has another shape.
        """
        target = _shaped(target_position, "target_position")
        speed = _STILL if target_velocity is None else _shaped(target_velocity, "target_velocity")
        tracked = _NONE if tracked is None else tracked
        goal, pace = np.empty(LAYOUT.dof), np.empty(LAYOUT.dof)
        if not lead(
            target, speed, tracked, self.position, LAYOUT.lower, LAYOUT.upper, self.velocity_limit,
            self.acceleration_limit, self.jerk_limit, goal, pace,
        ):  # fmt: skip
            return self._brake(SmoothStatus.BAD_TARGET)
        self._lead_by_speed(tracked)
        self._input.target_position = goal.tolist()
        self._input.target_velocity = pace.tolist()
        result = self._advance()
        return self._brake(SmoothStatus.FAILED) if result is None else self._step(result)

    def brake(self) -> SmoothStep:
        """Return the command one period on when every joint comes to rest in the least time; REACHED at rest."""
        return self._brake(None)

    def _lead_by_speed(self, led: Flags) -> None:
        """Tell ruckig, where that has changed, which joints are led by speed; the others are led by position."""
        flags = led.tobytes()
        if flags != self._led:
            velocity, position = ruckig.ControlInterface.Velocity, ruckig.ControlInterface.Position
            self._input.per_dof_control_interface = [velocity if flag else position for flag in led]
            self._led = flags

    def _brake(self, status: SmoothStatus | None) -> SmoothStep:
        self._lead_by_speed(_ALL)
        self._input.target_velocity = self._zeros
        result = self._advance()
        if result is None:
            # Not even braking can be computed: stand still and leave the deceleration to the gate.
            self.velocity, self.acceleration = np.zeros(LAYOUT.dof), np.zeros(LAYOUT.dof)
            self._is_fed = False
            return self._step(SmoothStatus.FAILED)
        return self._step(result if status is None else status)

    def _advance(self) -> SmoothStatus | None:
        """Move the command on by one period; None if ruckig refuses."""
        if not self._is_fed:
            self._input.current_position = self.position.tolist()
            self._input.current_velocity = self.velocity.tolist()
            self._input.current_acceleration = self.acceleration.tolist()
        try:
            result = self._ruckig.update(self._input, self._output)
        except (ruckig.RuckigError, ValueError):
            return None
        if result not in (ruckig.Result.Working, ruckig.Result.Finished):
            return None
        self._take()
        return SmoothStatus.REACHED if result is ruckig.Result.Finished else SmoothStatus.MOVING

    def _take(self) -> None:
        """Store the command; joints carried farther outside their limits than they were stop where they were."""
        output = self._output
        position, velocity = np.array(output.new_position), np.array(output.new_velocity)
        acceleration = np.array(output.new_acceleration)
        moved, stopped = put_back(position, velocity, acceleration, self.position, LAYOUT.lower, LAYOUT.upper)
        self.clamped += stopped
        self.position, self.velocity, self.acceleration = position, velocity, acceleration
        self._is_fed = not moved
        if self._is_fed:
            output.pass_to_input(self._input)

    def _step(self, status: SmoothStatus) -> SmoothStep:
        return SmoothStep(status, self.position, self.velocity, self.acceleration)


def _shaped(values: ArrayLike, name: str) -> Vector:
    array = np.asarray(values, dtype=float)
    if array.shape != (LAYOUT.dof,):
        raise ValueError(f"{name}: got shape {array.shape}, allowed is ({LAYOUT.dof},)")
    return array


def _checked(values: ArrayLike, name: str) -> Vector:
    array = _shaped(values, name).copy()
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: {LAYOUT.names[int(np.argmin(np.isfinite(array)))]} is not finite")
    return array
