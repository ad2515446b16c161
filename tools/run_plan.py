"""The plan's part of the report: priorities, the components left to each grasp, and the grips that were taken."""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np

from preshape.control.grips import Grip
from preshape.hal.layout import Side
from preshape.hal.world import FACES, Face, NominalBox, Opening, face_normal
from preshape.planner.areas import Areas, plan_areas
from preshape.planner.component import Component
from preshape.planner.priorities import priority_table
from preshape.planner.procedure import PAPER_PROCEDURE, SIDE_OF, Block
from preshape.tools.report import GripReport, PlanReport


def grip_report(grip: Grip) -> GripReport:
    """Return how a grip lies on the box: the faces that its palm (z axis) and its fingers (x axis) look against."""
    return GripReport(name=grip.name, palm=_against(grip.X_box_palm[:3, 2]), fingers=_against(grip.X_box_palm[:3, 0]))


def _against(direction: np.ndarray) -> Face:
    return max(FACES, key=lambda face: float(-direction @ face_normal(face)))


def report_plan(box: NominalBox, opening: Opening | None, grips: Mapping[Side, Grip]) -> PlanReport:
    """Plan the areas of the procedure and return them; grasps that were carried out count as chosen."""
    taken = {side: grip_report(grip) for side, grip in grips.items()}

    def choose(block: Block, candidates: tuple[Component, ...]) -> Component:
        grip = taken.get(SIDE_OF[block.resource]) if block.resource != "c" else None
        matching = [c for c in candidates if grip is not None and (grip.palm, True) == (c.palm, grip.fingers in c.pair)]
        return (matching or list(candidates))[0]

    started = time.perf_counter()
    areas: Areas = plan_areas(PAPER_PROCEDURE, box, opening, choose=choose)
    time_ms = (time.perf_counter() - started) * 1e3
    grasps = [area for area in areas.blocks if area.block.want == "grasp"]
    return PlanReport(
        time_ms=time_ms,
        priorities={str(k): v for k, v in priority_table(PAPER_PROCEDURE, areas.priorities).items()},
        components={str(area.block): [str(c) for c in area.candidates] for area in grasps},
        chosen={str(area.block): str(area.chosen) for area in grasps if area.chosen is not None},
        grips={side: grip for side, grip in taken.items()},
    )
