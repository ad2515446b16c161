"""The patient controller of a recorded run: it begins its steps, and holds, in the ticks in which that one did."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from preshape.control.controller import Controller, Setpoint
from preshape.hal.state import RobotState, Vector
from preshape.hal.tick_record import TickRecord
from preshape.tools.held_motion import HeldMotion


class Pace(NamedTuple):
    """Whether a step of the controller was begun in a tick, and whether the tick held."""

    begun: bool
    held: bool


IN_TIME = Pace(begun=True, held=False)


def paces(ticks: TickRecord) -> dict[int, Pace]:
    """Return how the controller kept up in each tick number of a recording."""
    # Ticks before the controller's first step carry its number, too: the last one of a number counts.
    kept = zip(ticks["begun"].tolist(), ticks["held"].tolist(), strict=True)
    return dict(zip(ticks["tick"].tolist(), map(Pace._make, kept), strict=True))


class ReplayPatient:
    """`tools.patient.PatientController` without its thread: a step is done at once, its answer used if it was in time.

    The inner controller sees the states, times and ticks that it saw then.
    """

    def __init__(self, inner: Controller, kept: Mapping[int, Pace], period_s: float) -> None:
        """Wrap a controller; `kept` says how the recorded one kept up in each tick of `period_s`."""
        self._inner, self._kept = inner, kept
        self._motion = HeldMotion(period_s)
        self._answer: Setpoint | Exception | None = None
        self._steps = 0

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        """Return the inner controller's setpoint, or that of the motion held where the tick held."""
        pace = self._kept.get(tick, IN_TIME)
        if pace.begun:
            if isinstance(self._answer, Exception):
                raise self._answer
            followed = self._motion.take_over()
            if followed is not None:
                self._inner.follow(*followed)
            self._answer = self._think(now_ns, state)
        if pace.held:
            return self._motion.step()
        if isinstance(self._answer, Exception):
            raise self._answer
        if self._answer is None:
            raise RuntimeError(f"tick {tick}: neither held nor begun")
        self._motion.note(self._answer)
        return self._answer

    def follow(self, position: Vector, velocity: Vector) -> None:
        """Let the inner controller's next step continue from this command."""
        self._motion.follow(position, velocity)

    def note(self, record: TickRecord) -> None:
        """Let the inner controller write into the record."""
        self._inner.note(record)

    def _think(self, now_ns: int, state: RobotState) -> Setpoint | Exception:
        self._steps += 1
        try:
            answer = self._inner.step(self._steps - 1, now_ns, state)
        except (ArithmeticError, AssertionError, LookupError, RuntimeError, TypeError, ValueError) as error:
            return error
        return Setpoint(answer.position.copy(), answer.torque_limit.copy(), answer.finished)
