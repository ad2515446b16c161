"""The safety gate: the last code between any controller and a device. Nothing passes that the joints must not do."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from preshape.hal.gate_config import AgeTier, GateConfig, GateVerdict
from preshape.hal.layout import LAYOUT
from preshape.hal.motion_limit import MotionLimits, StepLimiter
from preshape.hal.state import RobotState, Vector
from preshape.hal.state_monitor import StateMonitor, all_finite, first_not_finite

EPSILON = 1e-9
"""Differences whose norm is below this (rad, N m) are rounding, not violations."""

COUNTED = ("position", "velocity", "acceleration", "torque", "stale", "braked")
"""What `SafetyGate.counts` counts: ticks clipped by each limit, ticks with samples to warn of, ticks braked."""

LIMITS = MotionLimits(LAYOUT.lower, LAYOUT.upper, LAYOUT.velocity, LAYOUT.acceleration)


class SafetyGate:
    """Limits every request and latches a stop with its reason; one per loop.

    `position` (rad), `step` (its last change, rad) and `torque_limit` (N m), each (40,), are the output:
    buffers that live as long as the gate and change with every `check`; `position` is NaN until the
    first finite measurement. `counts` says how often what was clipped, stale or braked.

    Laws: while not armed, and so before the first command and after any stop, the output position is the
    newest finite measured one and the torque limit 0; a stop is latched until `arm`; `arm` restarts from the
    measured position at rest; every armed output keeps the limits of `StepLimiter` and
    0 <= torque_limit <= LAYOUT.torque.
    """

    def __init__(self, config: GateConfig | None = None) -> None:
        self.config = config or GateConfig()
        self.position = np.full(LAYOUT.dof, np.nan)
        self.step = np.zeros(LAYOUT.dof)
        self.torque_limit = np.zeros(LAYOUT.dof)
        self._monitor = StateMonitor(self.config)
        self._limiter = StepLimiter(LIMITS, self.config.period_s)
        self._next, self._work = np.empty(LAYOUT.dof), np.empty(LAYOUT.dof)
        self._armed = self._tightened = False
        self._reason = ""
        self._last_ns = 0
        self._counts: dict[str, int] = {name: 0 for name in COUNTED}
        self.counts: Mapping[str, int] = MappingProxyType(self._counts)

    @property
    def armed(self) -> bool:
        """Whether requests reach the output."""
        return self._armed

    @property
    def reason(self) -> str:
        """Why the gate has stopped or refused to arm; empty if neither."""
        return self._reason

    @property
    def age_tier(self) -> AgeTier:
        """Tier of the oldest sample of the last state checked while armed."""
        return self._monitor.age_tier

    @property
    def at_rest(self) -> bool:
        """Whether the output stands still."""
        return not self.step.any()

    def arm(self, now_ns: int, state: RobotState) -> bool:
        """Start from the measured position at rest; on False `reason` tells why the state does not allow it."""
        self._monitor.reset()
        fault = self._monitor.fault(now_ns, state)
        if not fault and self.age_tier >= AgeTier.FREEZE:
            fault = f"stale state: {LAYOUT.names[int(state.stamp_ns.argmin())]} is in tier {self.age_tier.name}"
        self._disarm(fault)
        if fault:
            return False
        np.copyto(self.position, state.position)
        np.copyto(self.torque_limit, LAYOUT.torque)
        self._armed, self._last_ns = True, now_ns
        return True

    def stop(self, reason: str) -> None:
        """Latch a stop; the first reason stays. `ValueError` for an empty one."""
        if not reason:
            raise ValueError("reason: got an empty text, a stop must have a name")
        self._disarm(self._reason or reason)

    def check(
        self, now_ns: int, state: RobotState, position: Vector | None = None, torque_limit: Vector | None = None
    ) -> GateVerdict:
        """Judge one request (each (40,)) and advance the output by one period.

        Without a request, and where samples are too old, the output decelerates as hard as the limits allow.

        Raises:
            ValueError: the request has another shape.
        """
        if self._armed:
            fault = self._watchdog_fault(now_ns) or self._monitor.fault(now_ns, state)
            self._counts["stale"] += self.age_tier >= AgeTier.WARN
            if fault:
                self.stop(fault)
        self._last_ns = now_ns
        if not self._armed:
            return self._measured_output(state)
        if position is None or torque_limit is None or self.age_tier >= AgeTier.FREEZE:
            return self._brake_output()
        fault = _value_fault(position, torque_limit)
        return self._stop_output(fault, state) if fault else self._limit_output(state, position, torque_limit)

    def _disarm(self, reason: str) -> None:
        self._reason = reason
        self._armed = self._tightened = False
        self.step[:] = 0.0
        self.torque_limit[:] = 0.0

    def _watchdog_fault(self, now_ns: int) -> str:
        gap_s = (now_ns - self._last_ns) * 1e-9
        if 0.0 <= gap_s <= self.config.watchdog_s:
            return ""
        return f"watchdog: {gap_s * 1e3:.1f} ms since the last check, allowed is 0 .. {self.config.watchdog_s * 1e3:g}"

    def _measured_output(self, state: RobotState) -> GateVerdict:
        if all_finite(state.position):
            np.copyto(self.position, state.position)
        return GateVerdict.STOPPED if self._reason else GateVerdict.DISARMED

    def _stop_output(self, reason: str, state: RobotState) -> GateVerdict:
        self.stop(reason)
        return self._measured_output(state)

    def _brake_output(self) -> GateVerdict:
        self._counts["braked"] += 1
        if self.age_tier >= AgeTier.HOLD and not self._tightened:
            self.torque_limit *= self.config.hold_torque_ratio
            self._tightened = True
        self._limiter.brake(self.position, self.step, self._next)
        self._advance()
        return GateVerdict.BRAKED

    def _limit_output(self, state: RobotState, position: Vector, torque_limit: Vector) -> GateVerdict:
        self._limiter.clip(position, self.position, self.step, self._next)
        np.subtract(position, self._next, out=self._work)
        clipped = bool(self._work @ self._work > EPSILON**2)
        np.maximum(torque_limit, 0.0, out=self._work)
        np.minimum(self._work, LAYOUT.torque, out=self._work)
        np.copyto(self.torque_limit, self._work)
        np.subtract(torque_limit, self._work, out=self._work)
        weakened = bool(self._work @ self._work > EPSILON**2)
        if clipped or weakened:
            fault = self._gross_fault(position, torque_limit)
            if fault:
                return self._stop_output(fault, state)
            self._count_clips(position, weakened)
        self._tightened = False
        self._advance()
        return GateVerdict.CLIPPED if clipped or weakened else GateVerdict.PASSED

    def _advance(self) -> None:
        np.subtract(self._next, self.position, out=self.step)
        np.copyto(self.position, self._next)

    def _gross_fault(self, position: Vector, torque_limit: Vector) -> str:
        """Return the violation that is too large to be clipped, or an empty text."""
        config = self.config
        speed = np.abs(position - self.position) / config.period_s
        outside = np.maximum(position - LIMITS.upper, LIMITS.lower - position)
        checks = (
            ("speed", "rad/s", speed, config.velocity_gross * LIMITS.velocity),
            ("distance outside the limits", "rad", outside, np.full(LAYOUT.dof, config.position_gross_rad)),
            ("torque limit", "N m", torque_limit, config.torque_gross * LAYOUT.torque),
        )
        for name, unit, got, allowed in checks:
            joint = int(np.argmax(got - allowed))
            if got[joint] > allowed[joint]:
                bound = f"stops above {allowed[joint]:.3f} {unit}"
                return f"requested {name} of {LAYOUT.names[joint]} is {got[joint]:.3f}, {bound}"
        return ""

    def _count_clips(self, position: Vector, weakened: bool) -> None:
        dt = self.config.period_s
        step = position - self.position
        outside = np.maximum(position - LIMITS.upper, LIMITS.lower - position)
        self._counts["position"] += int(outside.max() > EPSILON)
        self._counts["velocity"] += int((np.abs(step) - LIMITS.velocity * dt).max() > EPSILON)
        self._counts["acceleration"] += int((np.abs(step - self.step) - LIMITS.acceleration * dt * dt).max() > EPSILON)
        self._counts["torque"] += int(weakened)


def _value_fault(position: Vector, torque_limit: Vector) -> str:
    """Return which requested value is not finite, or an empty text."""
    for name, values in (("position", position), ("torque limit", torque_limit)):
        if values.shape != (LAYOUT.dof,):
            raise ValueError(f"requested {name}: got shape {values.shape}, allowed is ({LAYOUT.dof},)")
        if not all_finite(values):
            return f"requested {name} of {first_not_finite(values)} is not finite"
    return ""
