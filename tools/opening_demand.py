"""What opening a box asks of the hand that holds it: the loads of crushing the tab and of tearing the lid.

Both panels are rigid. A tab of depth d whose free edge tears at F asks the moment F d about its hinge; a hinge
moment T loads the lid's point at distance r_i with T r_i / sum_j r_j^2, so the farthest intact points tear at
T = F sum_j r_j^2 / max_j r_j, and the hardest of these stages counts. Creases add their yield moment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preshape.control.opening_motion import HINGE_ROOM, TIP_X
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.sim_backend.paper_box import lid_frame, perforation_arms
from preshape.sim_backend.scenario import Scenario, StrengthsSection
from preshape.tools.grip_capacity import push_at


@dataclass(frozen=True, slots=True, eq=False)
class Demand:
    """One load: its unit wrench (6,) about the box's centre, for 1 N, and how many N it takes."""

    name: str
    wrench: Vector
    newton: float


def hardest_tear(arms: Matrix, point_n: float) -> float:
    """Return the largest hinge moment, N m, on the way from all points intact to none; the farthest tear first."""
    worst, intact = 0.0, np.sort(np.asarray(arms, float))
    while len(intact):
        worst = max(worst, point_n * float(intact @ intact) / float(intact[-1]))
        intact = intact[intact < intact[-1] - 1e-9]
    return worst


def crease_moment(strengths: StrengthsSection) -> float:
    """Return the largest moment of the lid's crease before it yields, N m; the tab's is half of it."""
    return strengths.crease_nm_per_rad * strengths.crease_yield_rad


def demands(scenario: Scenario) -> tuple[Demand, ...]:
    """Return the loads of opening a drawn scenario's box at its strengths.

    `push`: the thumb on the tab, where the controller sets it down. `pull`: outward at the hole's inner rim.
    `lever`: the same force at the rim with its opposite on the side wall's edge beyond the hole, nearly a couple.
    """
    frame, s = lid_frame(scenario), scenario.strengths
    R, origin = frame.X_box_lid[:3, :3], frame.X_box_lid[:3, 3]
    outward = R[:, 2]

    def at(arm: float) -> Matrix:
        return origin + R @ np.array([arm, frame.tab_offset, 0.0])

    thumb_arm = frame.tab_depth / 2 + TIP_X
    push = (s.tab_n * frame.tab_depth + crease_moment(s) / 2) / thumb_arm
    rim = frame.depth - frame.tab_depth / 2 - HINGE_ROOM
    tear = (hardest_tear(perforation_arms(frame, s.points), s.point_n) + crease_moment(s)) / rim
    pull = push_at(at(rim), outward)
    return (
        Demand("push", push_at(at(frame.depth - frame.tab_depth + thumb_arm), -outward), push * s.scale),
        Demand("pull", pull, tear * s.scale),
        Demand("lever", pull + push_at(at(frame.depth), -outward), tear * s.scale),
    )
