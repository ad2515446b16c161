"""The plan of a run as reported and drawn: priorities, the components left to each grasp, the grips that were taken."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from preshape.control.grip import Grip
from preshape.control.procedure_areas import finger_face, palm_face, procedure_areas, realizes
from preshape.hal.layout import Side
from preshape.hal.world import NominalBox, Opening
from preshape.planner.areas import Areas, BlockArea
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.planner.priorities import priority_table
from preshape.planner.procedure import PAPER_PROCEDURE, SIDE_OF
from preshape.tools.plan_drawing import GraspDrawing, PartDrawing, PlanDrawing
from preshape.tools.report import GripReport, PlanReport


@dataclass(frozen=True, slots=True, eq=False)
class RunPlan:
    """Areas of the procedure for the opening that was found, and the grips carried out; they count as chosen."""

    areas: Areas
    grips: Mapping[Side, Grip]
    time_ms: float


def plan_run(box: NominalBox, opening: Opening | None, grips: Mapping[Side, Grip]) -> RunPlan:
    """Plan the procedure's areas; where a grip was carried out, its component is the one chosen."""
    started = time.perf_counter()
    areas = procedure_areas(box, opening, grips)
    return RunPlan(areas, dict(grips), (time.perf_counter() - started) * 1e3)


def _grasps(plan: RunPlan) -> list[BlockArea]:
    return [area for area in plan.areas.blocks if area.block.want == "grasp"]


def plan_report(plan: RunPlan) -> PlanReport:
    """Return the plan's part of the report."""
    return PlanReport(
        time_ms=plan.time_ms,
        priorities={str(k): v for k, v in priority_table(PAPER_PROCEDURE, plan.areas.priorities).items()},
        components={str(area.block): [str(c) for c in area.candidates] for area in _grasps(plan)},
        chosen={str(area.block): str(area.chosen) for area in _grasps(plan) if area.chosen is not None},
        grips={
            side: GripReport(name=grip.name, palm=palm_face(grip), fingers=finger_face(grip))
            for side, grip in plan.grips.items()
        },
    )


def plan_drawing(plan: RunPlan) -> PlanDrawing:
    """Return what is drawn: the box, where the camera searches, each grip that was carried out with its component."""
    sections = plan.areas.sections
    searched = frozenset(patch for area in plan.areas.blocks if area.block.resource == "c" for patch in area.region)
    grasps = [_grasp_drawing(plan, area) for area in _grasps(plan)]
    return PlanDrawing(
        (PartDrawing(np.array(sections.size) / 2, cuts=sections.cuts),),
        tuple(grasp for grasp in grasps if grasp is not None),
        searched,
    )


def _grasp_drawing(plan: RunPlan, area: BlockArea) -> GraspDrawing | None:
    side = None if area.block.resource == "c" else SIDE_OF[area.block.resource]
    grip = None if side is None else plan.grips.get(side)
    component = area.chosen
    if side is None or grip is None or component is None or not realizes(grip, component):
        return None
    boxes = component.preshaping_boxes(*plan.areas.sections.corners(component.section))
    box = next(box for box in boxes if box.finger_face == finger_face(grip))
    X, p = grip.X_box_palm, hand_kinematics(side).tips(grip.preshape)[0]
    return GraspDrawing(
        str(area.block),
        side,
        0,
        component.section,
        box,
        p @ X[:3, :3].T + X[:3, 3],
        X,
        grip.preshape,
        area.region.patches,
        (str(component), f"{grip.name} grip, preshape"),
    )
