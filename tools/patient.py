"""A controller that may think longer than a tick: its steps run in a thread of their own."""

from __future__ import annotations

from dataclasses import dataclass
from queue import Empty, Queue, SimpleQueue
from threading import Thread

from preshape.control.controller import Controller, Setpoint
from preshape.hal.state import RobotState, Vector
from preshape.hal.tick_record import TickRecord
from preshape.tools.held_motion import HeldMotion
from preshape.tools.real_time import THINKING_PRIORITY, give_up_priority, take_priority

PATIENT_PERIODS = 1.3
"""How long a tick waits for its step before it holds, periods: to begin the next tick late by half a period disturbs a
motion less than to stand still for one."""
LONG_TICKS = 5
"""A step that has made so many ticks hold is planning. It goes on without priority: a kernel stops threads that keep a
core to themselves for most of a second, and this one would be stopped with the interpreter's lock in its hand."""


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    tick: int
    now_ns: int
    state: RobotState
    followed: tuple[Vector, Vector] | None


class PatientController:
    """`Controller` around another one, for loops in real time; a context manager that ends its thread.

    A step that is not ready in time makes the tick hold, and so do the ticks after it until it is: planning takes up
    to a second, and the arms come to rest meanwhile (`HeldMotion`). What a late step says is dropped, for the command
    has gone on without it; the inner controller then follows that command and goes on with the next state. Its ticks
    count its own steps. `held` counts the ticks that held.
    """

    def __init__(self, inner: Controller, patience_s: float, period_s: float) -> None:
        """Wrap a controller; a tick of `period_s` waits `patience_s` for its step."""
        self._inner, self._patience_s = inner, patience_s
        self._asked: SimpleQueue[_Step | None] = SimpleQueue()
        # Not a SimpleQueue: where a signal's handler outlasts the time that its `get` waits, it waits for ever.
        self._answers: Queue[Setpoint | Exception] = Queue()
        self._thread = Thread(target=self._think, name="controller", daemon=True)
        self._motion = HeldMotion(period_s)
        self._busy = self._holding = self._begun = False
        self._steps = self._waited = 0
        self.held = 0

    def __enter__(self) -> PatientController:
        self._thread.start()
        return self

    def __exit__(self, *cause: object) -> None:
        self._asked.put(None)
        self._thread.join(timeout=10.0)

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        """Return the inner controller's setpoint if it is ready in time, else that of the motion held meanwhile."""
        if self._busy and self._answer(0.0) is None:
            return self._hold()
        self._begin(now_ns, state)
        answer = self._answer(self._patience_s)
        if answer is None:
            return self._hold()
        self._motion.note(answer)
        return answer

    def _begin(self, now_ns: int, state: RobotState) -> None:
        self._asked.put(_Step(self._steps, now_ns, state, self._motion.take_over()))
        self._begun = self._busy = True
        self._steps += 1
        self._waited = 0

    def _answer(self, within_s: float) -> Setpoint | None:
        """Return what the step has come to, None if it is not ready within a time; an error of it is raised here."""
        try:
            answer = self._answers.get(timeout=within_s) if within_s > 0.0 else self._answers.get_nowait()
        except Empty:
            self._waited += 1
            if self._waited == LONG_TICKS:
                give_up_priority(self._thread.native_id or 0)
            return None
        if self._waited >= LONG_TICKS:
            take_priority(THINKING_PRIORITY, self._thread.native_id or 0)
        self._busy = False
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _hold(self) -> Setpoint:
        self.held += 1
        self._holding = True
        return self._motion.step()

    def follow(self, position: Vector, velocity: Vector) -> None:
        """Let the inner controller's next step continue from this command."""
        self._motion.follow(position, velocity)

    def note(self, record: TickRecord) -> None:
        """Let the inner controller write into the record, which may be half way through its step; say if it held."""
        self._inner.note(record)
        record["begun"], record["held"] = self._begun, self._holding
        self._begun = self._holding = False

    def _think(self) -> None:
        take_priority(THINKING_PRIORITY)
        while (asked := self._asked.get()) is not None:
            try:
                if asked.followed is not None:
                    self._inner.follow(*asked.followed)
                answer = self._inner.step(asked.tick, asked.now_ns, asked.state)
                # The inner controller's buffers change in its next step; what is held must not.
                self._answers.put(Setpoint(answer.position.copy(), answer.torque_limit.copy(), answer.finished))
            except Exception as error:
                self._answers.put(error)
