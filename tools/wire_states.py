"""Rules of the wire for the modules: what their states must never say. Pure; told frame by frame."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from preshape.hal.layout import LAYOUT
from preshape.hal.state import Vector
from preshape.tools.wire_commands import CommandRules
from preshape.tools.wire_rules import Positions, Violation, stop_limit_s
from preshape.tools.wire_table import FrameTable

TORQUE_RATIO, TORQUE_S = 1.2, 0.010
"""A module's torque may be above this share of a joint's limit for no longer than this, s."""


class StateRules:
    """Of one module's states: torque, the sequence they echo, and that nothing is armed that was not told to be."""

    def __init__(
        self, table: FrameTable, positions: Positions, commands: CommandRules, period_s: float, patience: int
    ) -> None:
        """Judge the states that a table describes, of a module that obeys a group's commands, one every period.

        It stops by itself after `patience` periods without any.
        """
        self._stop_s, self._patience_s = stop_limit_s(period_s), stop_limit_s(period_s, patience)
        self._table, self._positions, self._commands = table, positions, commands
        self._position, self._torque = table.columns["position"], table.columns["torque"]
        self._indices = self._position.indices
        self._limit = LAYOUT.torque[self._indices]
        self._over_since: Vector = np.full(len(self._indices), np.inf)
        self._armed = self._told = False
        self._stopped_s: float | None = None
        self._told_s = 0.0
        self._said = False
        self.torque_ratio = 0.0
        """Largest torque reported, as a share of the joint's limit."""

    def told_to_arm(self, time_s: float) -> None:
        """Note that the controller has told this module to arm."""
        self._told, self._told_s, self._stopped_s = True, time_s, None

    def stop(self, time_s: float) -> None:
        """Note a quick stop."""
        self._told = False
        if self._armed:
            self._stopped_s = self._stopped_s or time_s

    def judge(self, time_s: float, data: bytes) -> Iterator[Violation]:
        """Tell what is wrong with a state."""
        self._positions.add(time_s, self._indices, self._position.read(data))
        yield from self._judge_torque(time_s, np.abs(self._torque.read(data)))
        armed = self._table.word("state", data) == "armed"
        if armed and not self._armed and not self._told:
            yield self._broken(time_s, "arming", "armed without being told to")
        if armed and self._stopped_s is not None and time_s - self._stopped_s > self._stop_s and not self._said:
            self._said = True
            yield self._broken(time_s, "stop", f"still armed {time_s - self._stopped_s:.3f} s after a quick stop")
        if not armed:
            self._stopped_s, self._said = None, False
        elif not self._armed:
            self._told = False
        self._armed = armed
        sequence = self._table.number("sequence", data)
        if self._table.number("taken", data) and sequence not in self._commands.sent:
            yield self._broken(time_s, "sequence", f"took command {sequence}, which nobody sent")

    def judge_beat(self, time_s: float, armed: bool) -> Iterator[Violation]:
        """Tell what is wrong with a heartbeat: armed although nobody commands any more."""
        silent_s = self._silent_s(time_s)
        if armed and silent_s > self._patience_s:
            yield self._broken(time_s, "silence", f"armed {silent_s:.3f} s after the last command")

    def judge_watchdog(self, time_s: float) -> Iterator[Violation]:
        """Tell what is wrong with the message that nobody has commanded for too long: that it comes late."""
        silent_s = self._silent_s(time_s)
        if silent_s > self._patience_s:
            yield self._broken(time_s, "silence", f"stopped only {silent_s:.3f} s after the last command")

    def _silent_s(self, time_s: float) -> float:
        """Return for how long nobody has commanded; 0 where no command has come since the module was armed."""
        last_s = self._commands.last_s
        return 0.0 if last_s is None or last_s < self._told_s else time_s - last_s

    def _judge_torque(self, time_s: float, torque: Vector) -> Iterator[Violation]:
        ratio = torque / self._limit
        self.torque_ratio = max(self.torque_ratio, float(ratio.max()))
        over = ratio > TORQUE_RATIO
        self._over_since = np.where(over, np.minimum(self._over_since, time_s), np.inf)
        for place in np.flatnonzero(time_s - self._over_since > TORQUE_S):
            self._over_since[place] = np.inf
            text = f"{self._torque.joints[place]} reports {torque[place]:.3f} N m for more than {TORQUE_S * 1e3:g} ms"
            yield self._broken(time_s, "torque", f"{text}, its limit is {self._limit[place]:g}")

    def _broken(self, time_s: float, rule: str, text: str) -> Violation:
        return Violation(time_s, rule, self._table.owner, text)
