"""A procedure under control: its tasks as generators, one tick at a time, and the log of how each went."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from preshape.control.aim import note_aims
from preshape.control.approach import FieldGuide
from preshape.control.controller import Setpoint
from preshape.control.failure import TaskFailed
from preshape.control.guard import PATIENCE_S
from preshape.control.motions import Motion, wait
from preshape.control.sensor_watch import SensorWatch
from preshape.control.work import Work
from preshape.hal.layout import SIDES
from preshape.hal.state import RobotState, Vector
from preshape.hal.tick_record import TickRecord, note_opening, note_progress
from preshape.hal.world import PoseSample

T = TypeVar("T")
ATTEMPTS = 3
"""How often a grasp is tried, the first time included."""
RETRIED = ("missed", "slipped", "moved")
"""Classes of cause after which a grasp is tried again."""
PHASE_S = 60.0
"""Longest time of a phase, s; the slowest, a long path for a held box, takes a third of it."""
REST_S = 0.8
"""How long everything rests after the last task, s."""


@dataclass(slots=True)
class TaskLog:
    """One task's course: when it began and ended (s of the loop's clock), how, and in how many attempts."""

    task: int
    name: str
    outcome: str = "not started"
    start_s: float = 0.0
    end_s: float = 0.0
    attempts: int = 0


class ProcedureControl(ABC):
    """Implements `control.controller.Controller` for a procedure given as its tasks' names and their course."""

    def __init__(self, names: Sequence[str], work: Work, guide: FieldGuide, until_task: int) -> None:
        """Take everything the tasks work with; nothing moves before `step`. The run ends after task `until_task`."""
        self.work, self.guide, self.until_task = work, guide, until_task
        self.tasks = [TaskLog(number, name) for number, name in enumerate(names, start=1)]
        for log in self.tasks[until_task:]:
            log.outcome = "not asked"
        self.failure: str | None = None
        self._sensors = SensorWatch()
        self._phase, self._phase_ns = (0, ""), 0
        self._motion = self._run()
        self._finished = False

    @abstractmethod
    def procedure(self) -> Motion:
        """Run the tasks up to `until_task`, each through `task`; a `TaskFailed` that comes out ends the procedure."""

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        """Advance the procedure by one tick."""
        work = self.work
        work.body.update(now_ns, state)
        work.sight.update(now_ns)
        frozen = self._sensors.update(state.torque)
        if frozen:
            work.notes.append(f"torque sensor frozen, found in task {work.task} ({work.phase}): {', '.join(frozen)}")
        for side in SIDES:
            work.hands[side].update()
        if work.sight.held_by is not None:
            work.body.aims.pop(work.sight.held_by, None)
        work.guard.look()
        work.body.stands = work.guard.blocked
        if not self._finished:
            self._advance()
        setpoint = work.body.setpoint()
        return Setpoint(setpoint.position, setpoint.torque_limit, self._finished)

    def _advance(self) -> None:
        """Advance the procedure; while the arms stand before an obstacle it waits, and then has to find another way.

        Whatever a phase waits for, its time is limited.
        """
        work, guard = self.work, self.work.guard
        phase = work.task, work.phase
        if phase != self._phase:
            self._phase, self._phase_ns = phase, work.body.now_ns
        seconds = (work.body.now_ns - self._phase_ns) * 1e-9
        try:
            if seconds > PHASE_S:
                self._phase_ns = work.body.now_ns
                self._motion.throw(TaskFailed(f"timed out: {work.phase} has taken {PHASE_S:g} s"))
            elif not guard.blocked:
                next(self._motion)
            elif guard.stood_s > PATIENCE_S:
                self._motion.throw(TaskFailed(f"stalled: {guard.give_up()}"))
        except StopIteration:
            self._finished = True

    def follow(self, position: Vector, velocity: Vector) -> None:
        """Continue from a command that is not the last setpoint."""
        self.work.body.follow(position, velocity)

    def note(self, record: TickRecord) -> None:
        """Write what the controller is doing into the record."""
        work, estimate = self.work, self.work.sight.estimate
        sample = None if estimate is None else PoseSample(estimate.stamp_ns, estimate.X_world_box)
        note_progress(record, work.task, work.phase, "", sample)
        note_opening(record, work.opening)
        self.guide.note(record)
        note_aims(record, work.body.aims, None if sample is None else sample.X_world_box)

    def task(self, number: int, motion: Generator[None, None, T]) -> Generator[None, None, T]:
        """Run a motion as (an attempt at) a task and keep its log; return what the motion returns."""
        self.work.task = number
        log = self._log()
        log.start_s, log.attempts, log.outcome = self._now_s(), log.attempts + 1, "running"
        result = yield from motion
        log.outcome, log.end_s = "done", self._now_s()
        return result

    def grasped(
        self,
        number: int,
        grasp: Callable[[], Generator[None, None, T]],
        let_go: Callable[[], Motion],
        is_open: Callable[[], bool] = lambda: True,
    ) -> Generator[None, None, T]:
        """Run a task that grasps; a grasp that misses or slips is let go and tried again from a new look and plan.

        `is_open` tells whether another try is still possible. The last try's cause is the task's.
        """
        for left in reversed(range(ATTEMPTS)):
            try:
                return (yield from self.task(number, grasp()))
            except TaskFailed as failed:
                if not left or failed.kind not in RETRIED or not is_open():
                    raise
                self.work.notes.append(f"task {number}, attempt {self._log().attempts}: {failed.cause}; tried again")
            yield from let_go()
        raise AssertionError("the last try returns or raises")

    def _run(self) -> Motion:
        try:
            yield from self.procedure()
            yield from wait(self.work.body, REST_S)
        except TaskFailed as failed:
            log = self._log()
            self.failure = f"task {log.task} ({log.name}): {failed.cause}"
            log.outcome, log.end_s = failed.cause.split(":")[0], self._now_s()

    def _log(self) -> TaskLog:
        return self.tasks[self.work.task - 1]

    def _now_s(self) -> float:
        return self.work.body.now_ns * 1e-9
