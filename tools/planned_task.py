"""A scenario's task planned as the controller plans it: once before the opening is known, once after it was found."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from preshape.hal.object_shape import ShapeName, primitives
from preshape.hal.world import Face, NominalBox, Opening
from preshape.planner.air_pose import open_places
from preshape.planner.areas import BlockArea, Reading
from preshape.planner.parts import box_part, cylinder_part
from preshape.planner.plan import GraspPlan, PartPlan, Plan, make_plan
from preshape.planner.plan_scene import Held, PlanScene
from preshape.planner.procedure import LIFT_PROCEDURE, PAPER_PROCEDURE, Block, Resource, Task
from preshape.planner.work_object import WorkObject, box_object, object_of_parts
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import initial_box_pose, nominal_box, workcell


@dataclass(frozen=True, slots=True, eq=False)
class PlannedTask:
    """Both plans of a task; `after` is None for an object without an opening, or when there is no plan before.

    `time_ms`: how long each took the first time, and when asked again.
    """

    scenario: Scenario
    before: Plan
    after: Plan | None
    time_ms: dict[str, float]

    @property
    def last(self) -> Plan:
        """The plan that knows the most."""
        return self.before if self.after is None else self.after

    @property
    def feasible(self) -> bool:
        """Whether there is a plan for all tasks."""
        return self.last.certificate is None

    def _plans(self) -> tuple[tuple[PartPlan, int], ...]:
        """Return the chosen parts' plans, and by how much each one's task numbers are to be raised."""
        first = self.before.chosen
        if self.after is None:
            return ((first, 0),)
        last = self.after.chosen
        return (first, 0), (last, first.procedure.looked_in - last.procedure.looked_in)

    def _made_in(self, plan: PartPlan, first: int) -> bool:
        """Return whether what begins with a task is planned here: before or after the camera's last task."""
        early = first <= plan.procedure.looked_in
        return self.after is None or early == (plan is self.before.chosen)

    def tasks(self) -> tuple[Task, ...]:
        """Return all tasks in order, added regrasps among them."""
        return tuple(
            task for plan, _ in self._plans() for n, task in plan.procedure.numbered() if self._made_in(plan, n)
        )

    def priorities(self) -> dict[Resource, list[int | None]]:
        """Return p_ri, p_li, p_ci of eq. (3), one for each of the tasks."""
        table: dict[Resource, list[int | None]] = {}
        for plan, _ in self._plans():
            for resource, numbers in plan.priorities.items():
                kept = [p for n, p in enumerate(numbers, start=1) if self._made_in(plan, n)]
                table.setdefault(resource, []).extend(kept)
        return table

    def grasps(self) -> tuple[tuple[GraspPlan, PartPlan], ...]:
        """Return every grasp of the task once, in order, with the plan that it was made in."""
        return tuple(
            (replace(grasp, block=_raised(grasp.block, by)), plan)
            for plan, by in self._plans()
            for grasp in plan.grasps
            if self._made_in(plan, grasp.block.first)
        )

    def areas(self) -> tuple[BlockArea, ...]:
        """Return every area on the chosen part once, in order, as planned before or after the opening is found."""
        return tuple(
            replace(area, block=_raised(area.block, by))
            for plan, by in self._plans()
            for area in plan.areas.blocks
            if self._made_in(plan, area.block.first)
        )


def _raised(block: Block, by: int) -> Block:
    return replace(block, first=block.first + by, last=block.last + by)


def work_object(scenario: Scenario) -> WorkObject:
    """Return the object of a scenario as the planner knows it."""
    return shaped_object(scenario.shape, nominal_box(scenario))


def shaped_object(shape: ShapeName, box: NominalBox) -> WorkObject:
    """Return an object of a shape as the planner knows it; `box` is its outer size, and what may open."""
    if shape == "box":
        return box_object(box)
    x, y, z = box.size.tolist()
    parts = [
        box_part(p.name, p.size, p.X_object_part)
        if p.kind == "box"
        else cylinder_part(p.name, float(p.size[0]) / 2.0, float(p.size[2]), p.X_object_part)
        for p in primitives(shape, (x, y, z))
    ]
    return object_of_parts(parts)


def resting_scene(drawn: Scenario) -> PlanScene:
    """Return the scene at the start of a drawn scenario, all that is nominally known of it."""
    return PlanScene(workcell(drawn), work_object(drawn), initial_box_pose(drawn), open_places=open_places())


def plan_task(
    drawn: Scenario, reading: Reading = "committed", palm_on_end_caps_only: bool = False, again: bool = True
) -> PlannedTask:
    """Plan a drawn scenario's task.

    The opening is taken from the scenario where the controller would have found it in task 2, and the likely face
    where a glance would have told it, if the best grasp could not show the right one. `again`: plan everything twice,
    to tell what is kept from plan to plan.

    Raises:
        ValueError: an object that makes no sense.
    """
    procedure = PAPER_PROCEDURE if drawn.shape == "box" else LIFT_PROCEDURE
    times: dict[str, float] = {}
    scene = resting_scene(drawn)

    def planned(which: str, scene: PlanScene) -> Plan:
        plan = timed(times, which, lambda: make_plan(scene, procedure, reading, palm_on_end_caps_only))
        if again:
            timed(times, f"{which}_again", lambda: make_plan(scene, procedure, reading, palm_on_end_caps_only))
        return plan

    before = planned("before", scene)
    if drawn.shape != "box":
        return PlannedTask(drawn, before, None, times)
    opening = Opening(drawn.opening.face, drawn.opening.edge, drawn.opening.offset_m)
    if not _shows(before, opening.face):
        before = planned("before", replace(scene, likely=opening.face))
    if before.certificate is not None:
        return PlannedTask(drawn, before, None, times)
    return PlannedTask(drawn, before, planned("after", found_scene(before, opening)), times)


def _shows(plan: Plan, face: Face) -> bool:
    return plan.certificate is None and all(face in grasp.chosen.faces for grasp in plan.chosen.grasps)


def found_scene(before: Plan, opening: Opening) -> PlanScene:
    """Return the scene when the opening has been found: in the right hand, shown to the camera."""
    holding = before.chosen.grasp("r", before.chosen.procedure.looked_in)
    if holding is None:
        raise ValueError("the right hand holds nothing in the task that shows the object")
    taken = holding.chosen
    place = next(pose for pose in taken.poses if (pose.place, pose.face) == ("shown", opening.face))
    held = Held("r", taken.option.component, taken.option.thumb_face)
    return replace(before.scene, X_world_object=place.X_world_object, opening=opening, held=held, likely=None)


def timed(times: dict[str, float], name: str, run: Callable[[], Plan]) -> Plan:
    """Return what `run` returns and note how long it took, ms."""
    start = time.perf_counter()
    result = run()
    times[name] = (time.perf_counter() - start) * 1e3
    return result
