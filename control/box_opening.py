"""The box-opening procedure: the paper's five tasks, and what is tried again on the way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from preshape.control.approach import FieldGuide
from preshape.control.body import Body
from preshape.control.carrier import CarryOptions
from preshape.control.course import Course
from preshape.control.failure import TaskFailed
from preshape.control.field import FieldOptions
from preshape.control.grasp_choice import shown_face
from preshape.control.guard import ObstacleGuard
from preshape.control.hand import Hand
from preshape.control.let_go import let_go
from preshape.control.motions import Motion
from preshape.control.opening_frame import hinge_distance, opening_frame
from preshape.control.opening_motion import HandWaypoint, open_motion, push_motion
from preshape.control.procedure_control import ProcedureControl
from preshape.control.sight import Sight
from preshape.control.task_grasp import grasp_box
from preshape.control.task_open import play, present
from preshape.control.task_put_back import put_back
from preshape.control.task_regrasp import regrasp
from preshape.control.task_show import find_opening_area
from preshape.control.task_stand import stand_up
from preshape.control.work import Work
from preshape.hal.layout import SIDES, Side
from preshape.hal.transform import Matrix
from preshape.hal.world import (
    Face,
    NominalBox,
    Opening,
    Perception,
    TextureLibrary,
    Workcell,
    end_caps,
    face_normal,
)
from preshape.planner.air_pose import AirPlace, upper_face
from preshape.planner.work_object import box_object

GRASPS = 2
"""How often the box is taken from the table until its opening faces the robot."""
TASK_NAMES = ("grasp", "find opening", "regrasp", "crush", "open")


class BoxOpening(ProcedureControl):
    """The controller of a box that opens; `report_opening` is told what task 2 has found."""

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
        target = box_object(box)
        guard = ObstacleGuard(body, sight, box)
        work = Work(cell, box, target, body, sight, hands, guard, carry or CarryOptions(), library)
        guide = FieldGuide(body, sight, box, target, options or FieldOptions())
        super().__init__(TASK_NAMES, work, guide, until_task)
        self._report_opening = report_opening
        self._place = AirPlace()
        self._courses: tuple[Course, ...] = ()

    def procedure(self) -> Motion:
        """Run the tasks up to the last one asked for; a failed look is tried again while the box can be reached."""
        yield from self._take_and_find()
        if self.until_task < 3:
            return
        opening = self.work.opening
        assert opening is not None
        end = self._held_end()
        yield from self.grasped(3, lambda: regrasp(self.work, self.guide, end), self._let_go_left, self._right_holds)
        if self.until_task < 4:
            return
        toward = self._toward(opening)
        motions = (push_motion(toward), open_motion(toward, hinge_distance(self.work.box, opening)))
        yield from self.task(4, self._crush(opening, end, motions))
        if self.until_task == 5:
            yield from self.task(5, play(self.work, self.guide, opening, self._courses[1]))

    def _take_and_find(self) -> Motion:
        """Take the box and look for its opening; if it is not on the face shown, take it anew the other way round.

        Opened as it is, both hands would have straight fingers on the same face, long enough for their tips to meet.
        """
        work = self.work
        likely: Face | None = None
        for _ in range(GRASPS):
            yield from self.grasped(1, partial(self._take, likely), lambda: let_go(work, "right"))
            if self.until_task == 1:
                return
            face = shown_face(work.grips["right"])
            found = yield from self.task(2, find_opening_area(work, face, self._held_end(), self._place))
            if found and work.opening is not None and work.seen_at is not None:
                self._report_opening(work.opening, work.seen_at)
                return
            work.blank.add(face)
            unseen: list[Face] = [other for other in work.box.candidate_faces if other not in work.blank]
            if not unseen:
                break
            likely = unseen[0]
            work.notes.append(f"opening not on {face}: put back to be taken the other way round")
            yield from put_back(work, self._place)
        raise TaskFailed("unseen: the opening area was found on none of " + ", ".join(work.box.candidate_faces))

    def _take(self, likely: Face | None) -> Motion:
        """Stand the box up if it lies, and take it."""
        yield from stand_up(self.work)
        yield from grasp_box(self.work, self.guide, likely, self._place)

    def _let_go_left(self) -> Motion:
        """Take the left hand off a box that it has missed; the right hand holds firmly again."""
        self.work.hands["right"].ease(1.0)
        yield from let_go(self.work, "left")

    def _right_holds(self) -> bool:
        return self.work.sight.held_by == "right"

    def _held_end(self) -> Face:
        """Return the end cap in the right palm."""
        grip = self.work.grips["right"]
        X_palm_box = np.eye(4)
        X_palm_box[:3, :3] = grip.X_box_palm[:3, :3].T
        # The cap that looks against the palm's z axis is the one in the palm.
        down = np.diag([1.0, -1.0, -1.0, 1.0])
        return upper_face(down @ X_palm_box, end_caps(self.work.box.long_axis))

    def _toward(self, opening: Opening) -> float:
        """Return the sign of the opening frame's y axis on whose side the holding hand lies."""
        y = opening_frame(self.work.box, opening)[:3, 1]
        return float(np.sign(-y @ face_normal(self._held_end())))

    def _crush(self, opening: Opening, end: Face, motions: Sequence[Sequence[HandWaypoint]]) -> Motion:
        self.guide.see_opening(opening)
        self._courses = yield from present(self.work, opening, end, motions)
        yield from play(self.work, self.guide, opening, self._courses[0])
