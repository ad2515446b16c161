"""The controller of the box-opening procedure: five tasks as generators, one tick at a time."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from preshape.control.aim import note_aims
from preshape.control.approach import FieldGuide
from preshape.control.body import Body
from preshape.control.carrier import CarryOptions
from preshape.control.controller import Setpoint
from preshape.control.course import Course
from preshape.control.failure import TaskFailed
from preshape.control.field import FieldOptions
from preshape.control.guard import PATIENCE_S, ObstacleGuard
from preshape.control.hand import Hand
from preshape.control.motions import Motion, wait
from preshape.control.opening_frame import opening_frame
from preshape.control.opening_motion import HandWaypoint, open_motion, push_motion
from preshape.control.sensor_watch import SensorWatch
from preshape.control.sight import Sight
from preshape.control.task_grasp import grasp_box, put_back, shown_face
from preshape.control.task_open import play, present
from preshape.control.task_regrasp import regrasp
from preshape.control.task_show import find_opening_area
from preshape.control.task_stand import stand_up
from preshape.control.work import Work
from preshape.hal.layout import SIDES, Side
from preshape.hal.state import RobotState, Vector
from preshape.hal.tick_record import TickRecord, note_opening, note_progress
from preshape.hal.transform import Matrix
from preshape.hal.world import (
    FACES,
    Face,
    NominalBox,
    Opening,
    Perception,
    PoseSample,
    TextureLibrary,
    Workcell,
    face_normal,
)
from preshape.planner.air_pose import AirPlace, upper_face

T = TypeVar("T")
GRASPS = 2
"""How often the box is taken from the table until its opening faces the robot."""
PHASE_S = 60.0
"""Longest time of a phase, s; the slowest, a long path for a held box, takes a third of it."""
REST_S = 0.8
"""How long everything rests after the last task, s."""
TASK_NAMES = ("grasp", "find opening", "regrasp", "crush", "open")


@dataclass(slots=True)
class TaskLog:
    """One task's course: when it began and ended (s of the loop's clock), how, and in how many attempts."""

    task: int
    name: str
    outcome: str = "not started"
    start_s: float = 0.0
    end_s: float = 0.0
    attempts: int = 0


class BoxOpening:
    """Implements `control.controller.Controller`; `report_opening` is told what task 2 has found."""

    def __init__(
        self,
        cell: Workcell,
        box: NominalBox,
        library: TextureLibrary,
        perception: Perception,
        period_s: float,
        options: FieldOptions | None = None,
        report_opening: Callable[[Opening, Matrix], None] = lambda opening, X: None,
        carry: CarryOptions | None = None,
        until_task: int = len(TASK_NAMES),
    ) -> None:
        """Build everything; nothing moves before `step`. The run ends after task `until_task`."""
        if not 1 <= until_task <= len(TASK_NAMES):
            raise ValueError(f"until_task: got {until_task}, allowed is 1 .. {len(TASK_NAMES)}")
        body = Body(cell, period_s)
        sight = Sight(perception, body)
        hands: dict[Side, Hand] = {side: Hand(side, body) for side in SIDES}
        guard = ObstacleGuard(body, sight, box)
        self.work = Work(cell, box, library, body, sight, hands, guard, carry or CarryOptions())
        self.guide = FieldGuide(body, sight, box, options or FieldOptions())
        self.tasks = [TaskLog(number + 1, name) for number, name in enumerate(TASK_NAMES)]
        self.failure: str | None = None
        self._until_task = until_task
        for log in self.tasks[until_task:]:
            log.outcome = "not asked"
        self._report_opening = report_opening
        self._place = AirPlace()
        self._courses: tuple[Course, ...] = ()
        self._sensors = SensorWatch()
        self._phase, self._phase_ns = (0, ""), 0
        self._procedure = self._run()
        self._finished = False

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
                self._procedure.throw(TaskFailed(f"timed out: {work.phase} has taken {PHASE_S:g} s"))
            elif not guard.blocked:
                next(self._procedure)
            elif guard.stood_s > PATIENCE_S:
                self._procedure.throw(TaskFailed(f"stalled: {guard.give_up()}"))
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

    def _run(self) -> Motion:
        """Run the tasks in order; a failed grasp or look is tried again while the box can be reached."""
        try:
            yield from self._tasks()
            yield from wait(self.work.body, REST_S)
        except TaskFailed as failed:
            self.failure = f"task {self.work.task} ({TASK_NAMES[self.work.task - 1]}): {failed.cause}"
            self._log().outcome = failed.cause.split(":")[0]
            self._log().end_s = self._now_s()

    def _tasks(self) -> Motion:
        """Run the tasks up to the last one asked for."""
        yield from self._take_and_find()
        if self._until_task < 3:
            return
        opening = self.work.opening
        assert opening is not None
        end = self._held_end()
        yield from self._task(3, regrasp(self.work, self.guide, end))
        if self._until_task < 4:
            return
        toward = self._toward(opening)
        depth = float(np.abs(face_normal(opening.edge)) @ self.work.box.size)
        motions = (push_motion(toward), open_motion(toward, depth - self.work.box.tab_size[1] / 2))
        yield from self._task(4, self._crush(opening, end, motions))
        if self._until_task == 5:
            yield from self._task(5, play(self.work, opening, self._courses[1]))

    def _take_and_find(self) -> Motion:
        """Take the box and look for its opening; if it is not on the face shown, take it anew the other way round.

        Opened as it is, both hands would have straight fingers on the same face, long enough for their tips to meet.
        """
        work = self.work
        yield from self._task(1, stand_up(work))
        likely: Face | None = None
        unseen: list[Face] = list(work.box.candidate_faces)
        for _ in range(GRASPS):
            yield from self._task(1, grasp_box(work, self.guide, likely, self._place))
            if self._until_task == 1:
                return
            face = shown_face(work.grips["right"])
            found = yield from self._task(2, find_opening_area(work, face, self._held_end(), self._place))
            if found and work.opening is not None and work.seen_at is not None:
                self._report_opening(work.opening, work.seen_at)
                return
            unseen = [other for other in unseen if other != face]
            if not unseen:
                break
            likely = unseen[0]
            work.notes.append(f"opening not on {face}: put back to be taken the other way round")
            yield from put_back(work)
        raise TaskFailed("unseen: the opening area was found on none of " + ", ".join(work.box.candidate_faces))

    def _held_end(self) -> Face:
        """Return the end cap in the right palm."""
        grip = self.work.grips["right"]
        caps: tuple[Face, ...] = tuple(f for f in FACES if "xyz".index(f[1]) == self.work.box.long_axis)
        X_palm_box = np.eye(4)
        X_palm_box[:3, :3] = grip.X_box_palm[:3, :3].T
        # The cap that looks against the palm's z axis is the one in the palm.
        down = np.diag([1.0, -1.0, -1.0, 1.0])
        return upper_face(down @ X_palm_box, caps)

    def _toward(self, opening: Opening) -> float:
        """Return the sign of the opening frame's y axis on whose side the holding hand lies."""
        y = opening_frame(self.work.box, opening)[:3, 1]
        return float(np.sign(-y @ face_normal(self._held_end())))

    def _crush(self, opening: Opening, end: Face, motions: Sequence[Sequence[HandWaypoint]]) -> Motion:
        self._courses = yield from present(self.work, opening, end, motions)
        yield from play(self.work, opening, self._courses[0])

    def _task(self, number: int, motion: Generator[None, None, T]) -> Generator[None, None, T]:
        self.work.task = number
        log = self._log()
        log.start_s, log.attempts, log.outcome = self._now_s(), log.attempts + 1, "running"
        result = yield from motion
        log.outcome, log.end_s = "done", self._now_s()
        return result

    def _log(self) -> TaskLog:
        return self.tasks[self.work.task - 1]

    def _now_s(self) -> float:
        return self.work.body.now_ns * 1e-9
