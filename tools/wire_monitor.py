"""A passive monitor of the hand bus: listens to every frame and says which rule was broken, by whom and when.

It knows the shipped DBC file and the robot's limits, and nothing of the controller or the driver.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from preshape.tools.wire_commands import CommandRules
from preshape.tools.wire_rules import STOP_CYCLES, Positions, Violation
from preshape.tools.wire_states import StateRules
from preshape.tools.wire_table import FrameTable, frame_tables

PERIOD_S = 0.002
"""Time between two commands of a group, s."""
KEPT = 20
"""So many violations are kept in full; all are counted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WireVerdict:
    """What was on the wire.

    Attributes:
        violations: the first of them in full.
        broken: how often each rule was broken.
        frames: how often each message was seen, by the name that the DBC file gives it.
        damaged: frames whose length or checksum is wrong; whoever gets them must ignore them.
        unknown: frames with identifiers that the DBC file does not name, by identifier.
        errors: error frames.
        torque_limit_ratio: largest torque limit commanded, speed_ratio: largest speed commanded, torque_ratio:
            largest torque reported; as shares of the joints' own limits.
    """

    violations: tuple[Violation, ...]
    broken: Mapping[str, int]
    frames: Mapping[str, int]
    damaged: int
    unknown: Mapping[int, int]
    errors: int
    torque_limit_ratio: float
    speed_ratio: float
    torque_ratio: float

    @property
    def ok(self) -> bool:
        """Whether no rule was broken."""
        return not self.broken


class WireMonitor:
    """Takes frames in the order in which they were on the wire."""

    def __init__(
        self,
        period_s: float = PERIOD_S,
        tables: Mapping[int, FrameTable] | None = None,
        patience_cycles: int = STOP_CYCLES,
    ) -> None:
        """Expect one command of each group every period; `tables` describe the frames (default: the shipped DBC).

        Modules may wait for commands for `patience_cycles` periods.
        """
        self._tables = frame_tables() if tables is None else tables
        self._frames: Counter[str] = Counter()
        self._broken: Counter[str] = Counter()
        self._unknown: Counter[int] = Counter()
        self._damaged = self._errors = 0
        self._violations: list[Violation] = []
        self._channels: dict[str, object] = {}
        positions = Positions(period_s)
        self._commands = {
            table.owner: CommandRules(table, positions, period_s)
            for table in self._tables.values()
            if table.kind == "command"
        }
        self._states = {
            table.owner: StateRules(
                table, positions, self._commands[_group_of(table, self._tables)], period_s, patience_cycles
            )
            for table in self._tables.values()
            if table.kind == "state"
        }

    def take(self, time_s: float, frame_id: int, data: bytes, channel: object = None, is_error: bool = False) -> None:
        """Judge one frame; `channel` tells the buses apart: a quick stop is for those on its own."""
        if is_error:
            self._errors += 1
            return
        table = self._tables.get(frame_id)
        if table is None:
            self._unknown[frame_id] += 1
            return
        self._frames[table.name] += 1
        if table.kind == "quick_stop":
            self._stop(time_s, channel)
        elif not table.intact(data):
            self._damaged += 1
        elif table.kind == "command":
            self._channels[table.owner] = channel
            self._note(self._commands[table.owner].judge(time_s, data))
        elif table.kind == "state":
            self._channels[table.owner] = channel
            self._note(self._states[table.owner].judge(time_s, data))
        elif table.kind == "heartbeat":
            self._note(self._states[table.owner].judge_beat(time_s, table.word("state", data) == "armed"))
        elif table.kind == "emergency" and table.word("error", data) == "watchdog":
            self._note(self._states[table.owner].judge_watchdog(time_s))
        elif table.kind == "request" and _arms(table, data):
            self._states[table.owner].told_to_arm(time_s)

    def verdict(self) -> WireVerdict:
        """Return what was seen so far."""
        commands, states = self._commands.values(), self._states.values()
        return WireVerdict(
            violations=tuple(self._violations),
            broken=dict(self._broken),
            frames=dict(sorted(self._frames.items())),
            damaged=self._damaged,
            unknown=dict(sorted(self._unknown.items())),
            errors=self._errors,
            torque_limit_ratio=max((rules.torque_ratio for rules in commands), default=0.0),
            speed_ratio=max((rules.speed_ratio for rules in commands), default=0.0),
            torque_ratio=max((rules.torque_ratio for rules in states), default=0.0),
        )

    def _note(self, violations: Iterable[Violation]) -> None:
        for violation in violations:
            self._broken[violation.rule] += 1
            if len(self._violations) < KEPT:
                self._violations.append(violation)

    def _stop(self, time_s: float, channel: object) -> None:
        for owner, rules in (*self._commands.items(), *self._states.items()):
            if self._channels.get(owner) == channel:
                rules.stop(time_s)


def _arms(table: FrameTable, data: bytes) -> bool:
    """Return whether a request tells a module to arm."""
    return table.word("operation", data) == "write" and table.word("parameter", data) == "session"


def _group_of(state: FrameTable, tables: Mapping[int, FrameTable]) -> str:
    """Return the group whose commands drive the joints that a state reports."""
    joints = set(state.columns["position"].joints)
    return next(
        table.owner
        for table in tables.values()
        if table.kind == "command" and joints <= {*table.columns["target"].joints}
    )
