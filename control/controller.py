"""What the loop asks of a controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from preshape.hal.state import RobotState, Vector
from preshape.hal.tick_record import TickRecord


@dataclass(frozen=True, slots=True, eq=False)
class Setpoint:
    """What the controller wants now: positions (40,) rad, torque limits (40,) N m, and whether it is done."""

    position: Vector
    torque_limit: Vector
    finished: bool = False


class Controller(Protocol):
    """Anything that turns states into setpoints. It reads no clock: time comes in."""

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        """Return the setpoint of this tick; ticks count 0, 1, 2, ... one nominal period apart, however late."""
        ...

    def follow(self, position: Vector, velocity: Vector) -> None:
        """Continue from this command, (40,) rad and rad/s: what was written is not what the last setpoint said.

        Called once before the first step, with the position held, and after each tick in which the gate
        changed the setpoint. The arrays are the caller's: copy what is kept.
        """
        ...

    def note(self, record: TickRecord) -> None:
        """Write task, phase, distances and the object's estimate into the record of this tick."""
        ...
