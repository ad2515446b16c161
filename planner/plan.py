"""The plan: priorities, areas, and for each grasp the ranked options that every later task allows (section III)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import cast

from preshape.planner.areas import Areas, Reading, plan_areas
from preshape.planner.availability import Availability, Refusal
from preshape.planner.certificate import Certificate
from preshape.planner.option_choice import OptionChooser, RankedOption
from preshape.planner.plan_scene import PlanScene
from preshape.planner.priorities import priority_table
from preshape.planner.procedure import PAPER_PROCEDURE, Block, Hand, Procedure, Resource
from preshape.planner.regrasp_search import fewest_regrasps
from preshape.planner.sections import split
from preshape.planner.work_object import WorkPart


@dataclass(frozen=True, slots=True, eq=False)
class GraspPlan:
    """One grasp of the procedure: its block and its options, the chosen one first."""

    block: Block
    hand: Hand
    options: tuple[RankedOption, ...]

    @property
    def chosen(self) -> RankedOption:
        """The option taken."""
        return self.options[0]


@dataclass(frozen=True, slots=True, eq=False)
class PartPlan:
    """The plan on one part of the object.

    Attributes:
        part: the part.
        procedure: the procedure, with regrasps added where it needs them.
        regrasps: how many were added.
        areas: every block's area, priorities among them.
        grasps: one for each grasp of the procedure, in the order of its tasks; none without a plan.
        certificate: why there is no plan, None if there is one.
        refusals: what speaks against the options that were looked at and cannot be used.
    """

    part: WorkPart
    procedure: Procedure
    regrasps: int
    areas: Areas
    grasps: tuple[GraspPlan, ...]
    certificate: Certificate | None
    refusals: tuple[Refusal, ...]

    @property
    def priorities(self) -> Mapping[Resource, list[int | None]]:
        """Return p_ri, p_li, p_ci of eq. (3)."""
        return priority_table(self.procedure, self.areas.priorities)

    def grasp(self, hand: Hand, task: int) -> GraspPlan | None:
        """Return a hand's grasp in a task (from 1), None where it has none."""
        found = [g for g in self.grasps if g.hand == hand and g.block.covers(task)]
        return found[-1] if found else None


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Plans on all parts of the object; all grasps are on one part, the one `chosen`."""

    scene: PlanScene
    parts: tuple[PartPlan, ...]

    @property
    def chosen(self) -> PartPlan:
        """Return the part's plan whose first grasp ranks best, the first part's if there is none on any."""
        feasible = [part for part in self.parts if part.grasps]
        return min(feasible, key=lambda part: part.grasps[0].chosen.rank, default=self.parts[0])

    @property
    def certificate(self) -> Certificate | None:
        """Why there is no plan on any part, None if there is one."""
        return self.chosen.certificate

    def taking(self, hand: Hand, task: int, taken: RankedOption) -> Plan:
        """Return the plan with another option of a hand's grasp in a task (from 1) as the chosen one.

        Raises:
            ValueError: it is no option of that grasp.
        """
        part, grasp = self.chosen, self.chosen.grasp(hand, task)
        if grasp is None or not any(taken is option for option in grasp.options):
            raise ValueError(f"taken: {taken.option} is no option of hand {hand} in task {task}")
        others = tuple(option for option in grasp.options if option is not taken)
        moved = replace(grasp, options=(taken, *others))
        grasps = tuple(moved if other is grasp else other for other in part.grasps)
        return Plan(self.scene, (replace(part, grasps=grasps),) + tuple(p for p in self.parts if p is not part))

    def options(self, hand: Hand, task: int) -> tuple[RankedOption, ...]:
        """Return a hand's options in a task (from 1), the chosen one first; empty where it has no grasp."""
        grasp = self.chosen.grasp(hand, task)
        return () if grasp is None else grasp.options


def make_plan(
    scene: PlanScene,
    procedure: Procedure = PAPER_PROCEDURE,
    reading: Reading = "committed",
    palm_on_end_caps_only: bool = False,
) -> Plan:
    """Plan a procedure in a scene; pure: the same scene gives the same plan.

    Once before the opening is known, for tasks 1 and 2 (every candidate face counts as the opening), and once after,
    with `scene.opening` and `scene.held`, for tasks 3 to 5.

    Raises:
        ValueError: an object, opening or procedure that makes no sense.
    """
    return Plan(
        scene,
        tuple(_part_plan(scene, part, procedure, reading, palm_on_end_caps_only) for part in scene.target.parts),
    )


def _part_plan(
    scene: PlanScene, part: WorkPart, procedure: Procedure, reading: Reading, palm_on_end_caps_only: bool
) -> PartPlan:
    available = Availability(scene, part, split(part.box, scene.opening))
    chooser = OptionChooser(available)
    while True:
        withdrawn = available.withdrawn
        found = fewest_regrasps(procedure, part.box, scene.opening, reading, palm_on_end_caps_only, available.usable)
        chooser.begin(found.procedure)
        areas = plan_areas(
            found.procedure,
            part.box,
            scene.opening,
            reading,
            palm_on_end_caps_only,
            chooser.choose,
            available.usable,
            found.priorities,
        )
        if available.withdrawn == withdrawn:
            break
    grasps: list[GraspPlan] = []
    if found.certificate is None:
        areas_of_grasps = sorted((a for a in areas.blocks if a.chosen is not None), key=lambda a: a.block.first)
        grasps = [
            GraspPlan(area.block, cast(Hand, area.block.resource), chooser.ranked(area.block, area.candidates))
            for area in areas_of_grasps
        ]
    return PartPlan(
        part, found.procedure, found.regrasps, areas, tuple(grasps), found.certificate, available.refusals()
    )
