"""What in a measured state forbids moving: a device not armed, stale or non-finite samples, too much torque."""

from __future__ import annotations

import math

import numpy as np

from preshape.hal.gate_config import AgeTier, GateConfig
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, RobotState, Vector


def all_finite(values: Vector) -> bool:
    """Return whether no entry is NaN or infinite: then, and only then, the sum of squares is finite."""
    return math.isfinite(values @ values)


def first_not_finite(values: Vector) -> str:
    """Return the name of the first joint whose value is NaN or infinite."""
    return LAYOUT.names[int(np.argmin(np.isfinite(values)))]


class StateMonitor:
    """Judges states one a tick; `age_tier` is that of the oldest sample of the last one."""

    def __init__(self, config: GateConfig) -> None:
        self.config = config
        self.age_tier = AgeTier.FRESH
        self._allowed = LAYOUT.torque * config.torque_ratio
        self._work = np.empty(LAYOUT.dof)
        self._ticks = np.zeros(LAYOUT.dof, dtype=np.int64)
        self._torque_over = False

    def reset(self) -> None:
        """Forget for how long torques have been too high."""
        self._ticks[:] = 0
        self._torque_over = False

    def fault(self, now_ns: int, state: RobotState) -> str:
        """Return the first reason not to move, or an empty text."""
        if state.status is not DeviceStatus.ARMED:
            return f"device is {state.status.name}, not ARMED: {state.fault or 'no fault given'}"
        return self._age_fault(now_ns, state) or self._value_fault(state) or self._torque_fault(state)

    def _age_fault(self, now_ns: int, state: RobotState) -> str:
        age_ns = now_ns - int(state.stamp_ns.min())
        self.age_tier = self.config.tier(age_ns)
        if self.age_tier is not AgeTier.STOP:
            return ""
        return f"stale state: {LAYOUT.names[int(state.stamp_ns.argmin())]} is {age_ns * 1e-6:.1f} ms old"

    def _value_fault(self, state: RobotState) -> str:
        if all_finite(state.position) and all_finite(state.velocity) and all_finite(state.torque):
            return ""
        values = ("position", state.position), ("velocity", state.velocity), ("torque", state.torque)
        return next(f"measured {n} of {first_not_finite(v)} is not finite" for n, v in values if not all_finite(v))

    def _torque_fault(self, state: RobotState) -> str:
        np.abs(state.torque, out=self._work)
        np.subtract(self._work, self._allowed, out=self._work)
        if self._work.max() <= 0.0:
            if self._torque_over:
                self.reset()
            return ""
        self._torque_over = True
        self._ticks += 1
        self._ticks[self._work <= 0.0] = 0
        joint = int(self._ticks.argmax())
        if self._ticks[joint] * self.config.period_s < self.config.torque_time_s:
            return ""
        got, allowed = abs(state.torque[joint]), self._allowed[joint]
        return f"measured torque of {LAYOUT.names[joint]} is {got:.2f} N m, allowed is {allowed:.2f}"
