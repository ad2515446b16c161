"""Rules of the wire for the controller: what its commands must never hold. Pure; told frame by frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from preshape.hal.layout import LAYOUT
from preshape.hal.state import Vector
from preshape.tools.wire_rules import Positions, Violation, stop_limit_s
from preshape.tools.wire_table import FrameTable

SEQUENCES = 1 << 16
"""Sequence numbers wrap here; less than half of it ahead is newer."""
BURST = 10
"""So many commands in a row ..."""
BURST_PERIODS = 8.0
"""... take at least so many periods: a late one may be followed by one on time, but nothing is caught up."""
REMEMBERED = 256
"""So many commands back a module may answer."""

Flags = NDArray[np.bool_]


class CommandRules:
    """Of one group's commands: torque limits, speed of the targets, rate, sequence, the first after arming, stops."""

    def __init__(self, table: FrameTable, positions: Positions, period_s: float) -> None:
        """Judge the commands that a table describes, one every period."""
        self._table, self._positions, self._period_s = table, positions, period_s
        self._target, self._limit = table.columns["target"], table.columns["limit"]
        self._indices = self._target.indices
        self._speed, self._torque = LAYOUT.velocity[self._indices], LAYOUT.torque[self._indices]
        self._session, self._sequence = -1, 0
        self._last: Vector | None = None
        self._moved = False
        self._times: deque[float] = deque(maxlen=BURST)
        self._stopped: tuple[float, int] | None = None
        self.sent: deque[int] = deque(maxlen=REMEMBERED)
        self.last_s: float | None = None
        """When the last command was sent that was more than a poll."""
        self.torque_ratio = self.speed_ratio = 0.0
        """Largest torque limit and speed commanded, as shares of the joints' own limits."""

    def stop(self, time_s: float) -> None:
        """Note a quick stop of the controller's: the session that runs must not move anything any more."""
        self._stopped = self._stopped or (time_s, self._session)

    def judge(self, time_s: float, data: bytes) -> Iterator[Violation]:
        """Tell what is wrong with a command."""
        table = self._table
        session, sequence, mode = (
            table.number("session", data),
            table.number("sequence", data),
            table.word("mode", data),
        )
        yield from self._rate(time_s)
        if mode == "poll":
            return
        self.sent.append(sequence)
        self.last_s = time_s
        steps, self._sequence = (sequence - self._sequence) % SEQUENCES, sequence
        if session != self._session:
            self._session, self._last, self._moved, steps = session, None, False, 1
        elif not 0 < steps < SEQUENCES // 2:
            yield self._broken(time_s, "sequence", f"number {sequence} is not newer than the one before")
        enabled = self._enabled(data)
        if mode in ("position", "torque", "hold") and enabled.any():
            yield from self._after_stop(time_s, session)
            yield from self._torque_limit(time_s, data, enabled)
        if mode == "position" and enabled.any():
            yield from self._speed_limit(time_s, self._target.read(data), enabled, steps)
        else:
            # Whatever the joints did meanwhile: what they are led by next begins where they are.
            self._last, self._moved = None, False

    def _enabled(self, data: bytes) -> Flags:
        bits = self._table.number("enable", data)
        return np.array([bits >> place & 1 for place in range(len(self._indices))], dtype=bool)

    def _rate(self, time_s: float) -> Iterator[Violation]:
        self._times.append(time_s)
        took_s = time_s - self._times[0]
        if len(self._times) == BURST and took_s < BURST_PERIODS * self._period_s - 1e-6:
            self._times.clear()
            yield self._broken(time_s, "rate", f"{BURST} commands within {took_s * 1e3:.1f} ms")

    def _after_stop(self, time_s: float, session: int) -> Iterator[Violation]:
        if self._stopped is None:
            return
        stopped_s, stopped_session = self._stopped
        if session != stopped_session:
            self._stopped = None
        elif time_s - stopped_s > stop_limit_s(self._period_s):
            yield self._broken(time_s, "stop", f"session {session:#x} goes on {time_s - stopped_s:.3f} s after a stop")

    def _torque_limit(self, time_s: float, data: bytes, enabled: Flags) -> Iterator[Violation]:
        limit = self._limit.read(data)
        ratio = np.where(enabled, limit / self._torque, 0.0)
        self.torque_ratio = max(self.torque_ratio, float(ratio.max()))
        over = enabled & (limit > self._torque + 0.5 * self._limit.scale)
        for place in np.flatnonzero(over):
            text = f"limit of {self._limit.joints[place]} {limit[place]:.4f} N m, allowed is {self._torque[place]:g}"
            yield self._broken(time_s, "torque limit", text)

    def _speed_limit(self, time_s: float, target: Vector, enabled: Flags, steps: int) -> Iterator[Violation]:
        last, self._last = self._last, target
        if not self._moved:
            self._moved = True
            yield from self._first(time_s, target, enabled)
        if last is None:
            return
        speed = np.abs(target - last) / (max(1, steps) * self._period_s)
        slack = 2.0 * self._target.scale / self._period_s
        self.speed_ratio = max(self.speed_ratio, float(np.where(enabled, speed / self._speed, 0.0).max()))
        for place in np.flatnonzero(enabled & (speed > self._speed * 1.001 + slack)):
            text = f"target of {self._target.joints[place]} moves at {speed[place]:.3f} rad/s"
            yield self._broken(time_s, "speed", f"{text}, allowed is {self._speed[place]:g}")

    def _first(self, time_s: float, target: Vector, enabled: Flags) -> Iterator[Violation]:
        """Judge the first motion of a session: each target is a position measured just before, within a count."""
        for place in np.flatnonzero(enabled):
            error = self._positions.nearest_error(time_s, int(self._indices[place]), float(target[place]))
            if error > 1.001 * self._target.scale:
                text = f"first target of {self._target.joints[place]} is {error:.5f} rad from what was measured"
                yield self._broken(time_s, "first command", text)

    def _broken(self, time_s: float, rule: str, text: str) -> Violation:
        return Violation(time_s, rule, self._table.owner, text)
