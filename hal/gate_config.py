"""What the safety gate allows: thresholds and the verdicts it gives."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import IntEnum


class GateVerdict(IntEnum):
    """What the gate did with one request; from BRAKED on the request had no part in the output."""

    PASSED = 0
    CLIPPED = 1
    BRAKED = 2
    DISARMED = 3
    STOPPED = 4


class AgeTier(IntEnum):
    """How old the oldest joint sample is."""

    FRESH = 0
    WARN = 1
    FREEZE = 2
    HOLD = 3
    STOP = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class GateConfig:
    """Thresholds of the safety gate. Limits of the joints themselves come from `LAYOUT`.

    Attributes:
        period_s: time that one check advances the command by.
        warn_age_s: samples at least this old are counted.
        freeze_age_s: from here on requests are ignored: the output brakes to rest and stays.
        hold_age_s: from here on torque limits are tightened as well, by `hold_torque_ratio`.
        stop_age_s: from here on the gate stops, latched.
        watchdog_s: longest time between two checks before the gate stops.
        hold_torque_ratio: part of each requested torque limit that is left at the HOLD tier.
        velocity_gross: a step beyond this many times the velocity limit stops instead of being clipped.
        position_gross_rad: a request farther outside the position limits stops instead of being clipped.
        torque_gross: a requested torque limit beyond this many times the joint's own stops instead of being clipped.
        torque_ratio: measured torque beyond this many times the joint's limit ...
        torque_time_s: ... for this long stops.
    """

    period_s: float = 0.002
    warn_age_s: float = 0.010
    freeze_age_s: float = 0.020
    hold_age_s: float = 0.050
    stop_age_s: float = 0.100
    watchdog_s: float = 0.100
    hold_torque_ratio: float = 0.5
    velocity_gross: float = 3.0
    position_gross_rad: float = 0.1
    torque_gross: float = 2.0
    torque_ratio: float = 1.2
    torque_time_s: float = 0.010

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{field.name}: got {value}, allowed is a finite number > 0")
        ages = (self.warn_age_s, self.freeze_age_s, self.hold_age_s, self.stop_age_s)
        if sorted(ages) != list(ages):
            raise ValueError(f"ages warn, freeze, hold, stop: got {ages}, allowed is a rising order")
        if self.hold_torque_ratio > 1.0:
            raise ValueError(f"hold_torque_ratio: got {self.hold_torque_ratio}, allowed is 0 .. 1")

    @classmethod
    def at_rate(cls, rate_hz: float) -> GateConfig:
        """Return the defaults at a rate: below 500 Hz samples may be as many ticks old as there, not as old."""
        usual = cls()
        stretch = max(1.0, 1.0 / (rate_hz * usual.period_s))
        return cls(
            period_s=1.0 / rate_hz,
            warn_age_s=stretch * usual.warn_age_s,
            freeze_age_s=stretch * usual.freeze_age_s,
            hold_age_s=stretch * usual.hold_age_s,
            stop_age_s=stretch * usual.stop_age_s,
            watchdog_s=stretch * usual.watchdog_s,
        )

    def tier(self, age_ns: int) -> AgeTier:
        """Return the tier of a sample's age."""
        age_s = age_ns * 1e-9
        if age_s < self.warn_age_s:
            return AgeTier.FRESH
        if age_s >= self.stop_age_s:
            return AgeTier.STOP
        if age_s >= self.hold_age_s:
            return AgeTier.HOLD
        return AgeTier.FREEZE if age_s >= self.freeze_age_s else AgeTier.WARN
