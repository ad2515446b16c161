"""A planned task as shapes to draw: parts with their sections, the search area, every grasp at its preshape."""

from __future__ import annotations

import numpy as np

from preshape.hal.transform import Matrix
from preshape.planner.areas import BlockArea
from preshape.planner.plan import GraspPlan, PartPlan
from preshape.planner.preshaping_box import PreshapingBox
from preshape.planner.procedure import SIDE_OF
from preshape.tools.plan_drawing import GraspDrawing, PartDrawing, PlanDrawing
from preshape.tools.planned_task import PlannedTask


def plan_drawing(task: PlannedTask) -> PlanDrawing:
    """Return what `plan_picture` draws."""
    plan = task.last
    parts = tuple(_part(part) for part in plan.parts)
    grasps = tuple(_grasp(grasp, _index(task, part), task.areas()) for grasp, part in task.grasps())
    chosen = plan.chosen
    looked = chosen.areas.at("c", chosen.procedure.looked_in)
    searched = frozenset() if looked is None else looked.region.patches
    return PlanDrawing(parts, grasps, searched, _notes(task))


def _index(task: PlannedTask, plan: PartPlan) -> int:
    names = [part.part.name for part in task.last.parts]
    return names.index(plan.part.name)


def _part(plan: PartPlan) -> PartDrawing:
    part = plan.part
    return PartDrawing(part.half, part.X_object_part, plan.areas.sections.cuts, part.vertices)


def _grasp(grasp: GraspPlan, index: int, areas: tuple[BlockArea, ...]) -> GraspDrawing:
    ranked, option = grasp.chosen, grasp.chosen.option
    box = option.box
    in_object = PreshapingBox(box.palm_face, box.thumb_face, box.finger_face, option.X_object_pb, box.half, box.margin)
    area = next((a for a in areas if a.block == grasp.block), None)
    tips: Matrix = option.tips_object
    notes = (
        f"{len(option.fingers)} fingers, QP residual {option.preshape.residual_m * 1e3:.4f} mm",
        f"closure: line {option.closure.line_margin_m * 1e3:.0f} mm inside, cones {option.closure.epsilon:.3f}",
        f"clearance {ranked.clearance_m * 1e3:.1f} mm, {len(grasp.options)} options",
    )
    return GraspDrawing(
        f"{SIDE_OF[grasp.hand]} hand, tasks {grasp.block.first}-{grasp.block.last}",
        option.side,
        index,
        option.component.section,
        in_object,
        np.asarray(tips),
        option.X_object_palm,
        option.q_hand,
        frozenset() if area is None else area.region.patches,
        notes,
    )


def _notes(task: PlannedTask) -> tuple[str, ...]:
    rows = [f"{task.scenario.name}, seed {task.scenario.seed}", "priorities (eq. 3), tasks 1 .. n:"]
    for resource, numbers in task.priorities().items():
        rows.append(f"  {resource}: " + " ".join("*" if n is None else str(n) for n in numbers))
    for area in task.areas():
        rows.append(f"{area.block}: {len(area.region)} patches, {len(area.components)} components")
    return tuple(rows)
