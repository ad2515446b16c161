"""The patient controller of a recorded run: it holds in the ticks in which that one held."""

from __future__ import annotations

from collections.abc import Mapping

from preshape.control.controller import Controller, Setpoint
from preshape.hal.layout import LAYOUT
from preshape.hal.state import RobotState, Vector
from preshape.hal.tick_record import TickRecord


def held_ticks(ticks: TickRecord) -> dict[int, bool]:
    """Return, for each tick number of a recording, whether the controller was still thinking in it."""
    # Ticks before the controller's first step carry its number, too: the last one of a number counts.
    return dict(zip(ticks["tick"].tolist(), ticks["held"].tolist(), strict=True))


class ReplayPatient:
    """`tools.patient.PatientController` without its thread: a step is done at once, its answer used when it was ready.

    The inner controller sees the states, times and ticks that it saw then.
    """

    def __init__(self, inner: Controller, held: Mapping[int, bool]) -> None:
        """Wrap a controller; `held` says of each tick whether it repeated the last setpoint."""
        self._inner, self._held = inner, held
        self._setpoint: Setpoint | None = None
        self._followed: tuple[Vector, Vector] | None = None
        self._answer: Setpoint | Exception | None = None
        self._steps = 0

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        """Return the inner controller's setpoint, or the last one again where it was held."""
        if self._answer is None:
            if self._followed is not None:
                self._inner.follow(*self._followed)
                self._followed = None
            self._answer = self._think(now_ns, state)
        if self._held.get(tick, False):
            if self._setpoint is None:
                raise RuntimeError("held before the first command to follow")
            return self._setpoint
        answer, self._answer = self._answer, None
        if isinstance(answer, Exception):
            raise answer
        self._setpoint = answer
        return answer

    def follow(self, position: Vector, velocity: Vector) -> None:
        """Let the inner controller's next step continue from this command."""
        self._followed = position.copy(), velocity.copy()
        if self._setpoint is None:
            self._setpoint = Setpoint(position.copy(), LAYOUT.torque.copy())

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
