"""`preshape plan --json`, schema `preshape/plan/1`: a planned task as strict values."""

from __future__ import annotations

from typing import Literal

import msgspec

from preshape.hal import sah_hand
from preshape.hal.transform import Matrix
from preshape.planner.areas import BlockArea
from preshape.planner.availability import ArmPose
from preshape.planner.component import Component
from preshape.planner.option_choice import RankedOption
from preshape.planner.plan import GraspPlan, PartPlan
from preshape.planner.procedure import SIDE_OF
from preshape.planner.work_object import WorkPart
from preshape.tools.planned_task import PlannedTask

SCHEMA = "preshape/plan/1"
Numbers = list[float]


class Item(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every object in a plan's report: frozen, keyword-only, unknown keys refused."""


class PoseReport(Item, frozen=True):
    """A pose: position, m, and rotation matrix by rows."""

    position_m: Numbers
    rotation: list[Numbers]


class ComponentReport(Item, frozen=True):
    """A palm patch and an unordered pair of opposite grasp patches in one section (0, 1 or 2)."""

    section: int
    palm: str
    pair: list[str]


class AreaReport(Item, frozen=True):
    """The area of one block: its patches, how many parts they form, the components in it, and those left to choose."""

    block: str
    resource: str
    tasks: list[int]
    priority: int
    patches: list[tuple[int, str]]
    parts: int
    components: list[ComponentReport]
    candidates: list[ComponentReport]


class PreshapingBoxReport(Item, frozen=True):
    """A preshaping box in the object's frame: pose and edges, m."""

    pose: PoseReport
    size_m: Numbers
    margin_m: float


class ArmReport(Item, frozen=True):
    """Where an arm holds the object in a task: poses in the world, joints (7), rad, and their score."""

    place: str
    face: str | None
    object: PoseReport
    palm: PoseReport
    joints_rad: Numbers
    score: float


class OptionReport(Item, frozen=True):
    """One way to grasp; `palm` and `fingertips_m` are in the object's frame, joints (13) by name, rad."""

    part: str
    component: ComponentReport
    thumb_face: str
    finger_face: str
    faces: list[str]
    preshaping_box: PreshapingBoxReport
    fingers: list[str]
    fingertips_m: dict[str, Numbers]
    grasping_plane: PoseReport
    palm: PoseReport
    joints_rad: dict[str, float]
    qp_status: str
    qp_residual_mm: float
    qp_kkt: float
    qp_iterations: int
    closure_by_line: bool
    closure_line_margin_mm: float
    closure_by_cones: bool
    closure_epsilon: float
    clearance_mm: float
    distance_m: float
    hidden_share: float
    arm: list[ArmReport]


class GraspReport(Item, frozen=True):
    """One grasp of the procedure: its options, the chosen one first."""

    block: str
    hand: str
    tasks: list[int]
    chosen: OptionReport
    others: list[OptionReport]


class PartReport(Item, frozen=True):
    """A part of the object: its smallest box, the sections' cuts along its longest edge, areas, why it has no plan."""

    name: str
    pose: PoseReport
    size_m: Numbers
    cuts_m: Numbers
    areas: list[AreaReport]
    certificate: str | None
    refusals: list[str]


class TaskPlanReport(Item, frozen=True):
    """All of `preshape plan --json`.

    `parts` are those of the plan that knows the most; `areas` the chosen part's. `components`: by block, those in
    its area. `time_ms`: of both plans, first time and again. `certificate`: why there is no plan.
    """

    schema: Literal["preshape/plan/1"]
    scenario: str
    seed: int
    shape: str
    reading: str
    feasible: bool
    certificate: str | None
    priorities: dict[str, list[int | None]]
    regrasps_added: int
    tasks: list[str]
    areas: list[AreaReport]
    components: dict[str, list[str]]
    grasps: list[GraspReport]
    parts: list[PartReport]
    time_ms: dict[str, float]


def task_plan_report(task: PlannedTask) -> TaskPlanReport:
    """Return the report of a planned task."""
    last = task.last.chosen
    return TaskPlanReport(
        schema=SCHEMA,
        scenario=task.scenario.name,
        seed=task.scenario.seed,
        shape=task.scenario.shape,
        reading=last.areas.reading,
        feasible=task.feasible,
        certificate=None if last.certificate is None else str(last.certificate),
        priorities={str(resource): numbers for resource, numbers in task.priorities().items()},
        regrasps_added=task.before.chosen.regrasps + (0 if task.after is None else last.regrasps),
        tasks=[t.name for t in task.tasks()],
        areas=[_area(area) for area in task.areas()],
        components={str(area.block): [str(c) for c in area.components] for area in task.areas()},
        grasps=[_grasp(grasp) for grasp, _ in task.grasps()],
        parts=[_part(part) for part in task.last.parts],
        time_ms=task.time_ms,
    )


def _pose(X: Matrix) -> PoseReport:
    return PoseReport(position_m=_list(X[:3, 3]), rotation=[_list(row) for row in X[:3, :3]])


def _list(values: Matrix) -> Numbers:
    return [float(v) for v in values]


def _component(component: Component) -> ComponentReport:
    return ComponentReport(section=component.section, palm=component.palm, pair=list(component.pair))


def _area(area: BlockArea) -> AreaReport:
    block = area.block
    return AreaReport(
        block=str(block),
        resource=block.resource,
        tasks=list(range(block.first, block.last + 1)),
        priority=area.priority,
        patches=[(section, face) for section, face in sorted(area.region)],
        parts=len(area.region.parts()),
        components=[_component(c) for c in area.components],
        candidates=[_component(c) for c in area.candidates],
    )


def _part(plan: PartPlan) -> PartReport:
    part: WorkPart = plan.part
    return PartReport(
        name=part.name,
        pose=_pose(part.X_object_part),
        size_m=_list(2.0 * part.half),
        cuts_m=[float(cut) for cut in plan.areas.sections.cuts],
        areas=[_area(area) for area in plan.areas.blocks],
        certificate=None if plan.certificate is None else str(plan.certificate),
        refusals=[str(refusal) for refusal in plan.refusals],
    )


def _grasp(grasp: GraspPlan) -> GraspReport:
    return GraspReport(
        block=str(grasp.block),
        hand=SIDE_OF[grasp.hand],
        tasks=list(range(grasp.block.first, grasp.block.last + 1)),
        chosen=_option(grasp.chosen),
        others=[_option(ranked) for ranked in grasp.options[1:]],
    )


def _option(ranked: RankedOption) -> OptionReport:
    option = ranked.option
    box, preshape = option.box, option.preshape
    return OptionReport(
        part=option.part.name,
        component=_component(option.component),
        thumb_face=option.thumb_face,
        finger_face=option.finger_face,
        faces=list(ranked.faces),
        preshaping_box=PreshapingBoxReport(
            pose=_pose(option.X_object_pb), size_m=_list(2.0 * box.half), margin_m=box.margin
        ),
        fingers=list(option.fingers),
        fingertips_m={finger: _list(p) for finger, p in zip(option.fingers, option.tips_object, strict=True)},
        grasping_plane=_pose(option.reached_plane()),
        palm=_pose(option.X_object_palm),
        joints_rad=dict(zip(sah_hand.ACTUATED, _list(option.q_hand), strict=True)),
        qp_status=preshape.status.value,
        qp_residual_mm=preshape.residual_m * 1e3,
        qp_kkt=preshape.kkt_residual,
        qp_iterations=preshape.iterations,
        closure_by_line=option.closure.by_line,
        closure_line_margin_mm=option.closure.line_margin_m * 1e3,
        closure_by_cones=option.closure.by_cones,
        closure_epsilon=option.closure.epsilon,
        clearance_mm=ranked.clearance_m * 1e3,
        distance_m=ranked.distance_m,
        hidden_share=ranked.hidden_share,
        arm=[_arm(pose) for pose in ranked.poses],
    )


def _arm(pose: ArmPose) -> ArmReport:
    return ArmReport(
        place=pose.place,
        face=pose.face,
        object=_pose(pose.X_world_object),
        palm=_pose(pose.X_world_palm),
        joints_rad=_list(pose.q_arm),
        score=pose.score,
    )
