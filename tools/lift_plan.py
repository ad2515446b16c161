"""The plan of a lift as reported and drawn: the one that the controller made, the grip it took counting as chosen."""

from __future__ import annotations

import time

from preshape.planner.plan import GraspPlan, Plan, make_plan
from preshape.planner.priorities import derive_priorities, priority_table
from preshape.planner.procedure import LIFT_PROCEDURE, SIDE_OF
from preshape.sim_backend.scenario import Scenario
from preshape.tools.plan_drawing import PlanDrawing
from preshape.tools.plan_sketch import plan_drawing
from preshape.tools.planned_task import PlannedTask
from preshape.tools.report import GripReport, PlanReport


def lift_report(plan: Plan | None) -> PlanReport:
    """Return the plan's part of the report; a run that ended before it had planned has its priorities alone.

    The time is that of planning once more in the same scene.
    """
    if plan is None:
        priorities = priority_table(LIFT_PROCEDURE, derive_priorities(LIFT_PROCEDURE))
        return PlanReport(
            time_ms=0.0, priorities={str(k): v for k, v in priorities.items()}, components={}, chosen={}, grips={}
        )
    started = time.perf_counter()
    make_plan(plan.scene, LIFT_PROCEDURE)
    time_ms = (time.perf_counter() - started) * 1e3
    grasps = plan.chosen.grasps
    return PlanReport(
        time_ms=time_ms,
        priorities={str(k): v for k, v in plan.chosen.priorities.items()},
        components={str(grasp.block): _components(grasp) for grasp in grasps},
        chosen={str(grasp.block): str(grasp.chosen.option.component) for grasp in grasps},
        grips={SIDE_OF[grasp.hand]: _grip(grasp) for grasp in grasps},
    )


def _components(grasp: GraspPlan) -> list[str]:
    """Return the components that the grasp's options use, the chosen one first."""
    return list(dict.fromkeys(str(ranked.option.component) for ranked in grasp.options))


def _grip(grasp: GraspPlan) -> GripReport:
    option = grasp.chosen.option
    return GripReport(name=f"planned, {option.part.name}", palm=option.palm_face, fingers=option.finger_face)


def lift_drawing(drawn: Scenario, plan: Plan | None) -> PlanDrawing | None:
    """Return what is drawn: parts with their smallest boxes and sections, and the grasp; None without a plan."""
    return None if plan is None else plan_drawing(PlannedTask(drawn, plan, None, {}))
