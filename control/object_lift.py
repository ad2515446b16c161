"""The lift procedure: an object without an opening is grasped by the right hand, lifted and held."""

from __future__ import annotations

from preshape.control.approach import FieldGuide
from preshape.control.body import Body
from preshape.control.carrier import CarryOptions
from preshape.control.field import FieldOptions
from preshape.control.guard import ObstacleGuard
from preshape.control.hand import Hand
from preshape.control.let_go import let_go
from preshape.control.motions import Motion
from preshape.control.procedure_control import ProcedureControl
from preshape.control.sight import Sight
from preshape.control.task_lift import hold_object, lift_object
from preshape.control.work import Work
from preshape.hal.layout import SIDES, Side
from preshape.hal.world import NominalBox, Perception, Workcell
from preshape.planner.procedure import LIFT_PROCEDURE
from preshape.planner.work_object import WorkObject


class ObjectLift(ProcedureControl):
    """The controller of an object that is lifted, whatever parts it has."""

    def __init__(
        self,
        cell: Workcell,
        box: NominalBox,
        target: WorkObject,
        perception: Perception,
        period_s: float,
        options: FieldOptions | None = None,
        until_task: int = len(LIFT_PROCEDURE.tasks),
    ) -> None:
        """Build everything; `box` is the object's outer size, `target` its parts. Nothing moves before `step`.

        The run ends after task `until_task`.
        """
        body = Body(cell, period_s)
        sight = Sight(perception, body)
        hands: dict[Side, Hand] = {side: Hand(side, body) for side in SIDES}
        guard = ObstacleGuard(body, sight, box)
        work = Work(cell, box, target, body, sight, hands, guard, CarryOptions(), phase="look")
        names = [task.name for task in LIFT_PROCEDURE.tasks]
        super().__init__(names, work, FieldGuide(body, sight, box, target, options or FieldOptions()), until_task)

    def procedure(self) -> Motion:
        """Grasp and lift, then hold if that is asked for; a missed grasp is tried again."""
        work = self.work
        yield from self.grasped(1, lambda: lift_object(work, self.guide), lambda: let_go(work, "right"))
        if self.until_task == 2:
            yield from self.task(2, hold_object(work))
