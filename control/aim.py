"""What a hand is on its way to, for those who watch: its preshaping box and where its fingertips shall be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from preshape.hal.layout import SIDES, Side
from preshape.hal.state import Vector
from preshape.hal.tick_record import TickRecord, note_aim
from preshape.hal.transform import Matrix
from preshape.hal.world import FACES, Face, NominalBox, face_normal, opposite
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.planner.preshaping_box import PreshapingBox, box_from_component
from preshape.planner.sections import split


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """Fingertip targets (4, 3), m, in the object's frame, and the preshaping box where the hand comes to grasp."""

    tips_box: Matrix
    preshaping_box: PreshapingBox | None = None

    def tips(self, X_world_box: Matrix) -> Matrix:
        """Return the fingertip targets (4, 3) in the world, m."""
        return self.tips_box @ X_world_box[:3, :3].T + X_world_box[:3, 3]


def tips_of(side: Side, X_frame_palm: Matrix, fingers: Vector) -> Matrix:
    """Return the fingertips (4, 3), m, of a hand whose palm is at a pose in some frame, in that frame."""
    return hand_kinematics(side).tips(fingers)[0] @ X_frame_palm[:3, :3].T + X_frame_palm[:3, 3]


def grasp_aim(side: Side, X_box_palm: Matrix, fingers: Vector, box: NominalBox) -> Aim:
    """Return the aim of a hand that comes to grasp: the preshaping box is that of the section before its palm."""
    return Aim(tips_of(side, X_box_palm, fingers), _preshaping_box(X_box_palm, box))


def note_aims(record: TickRecord, aims: Mapping[Side, Aim], X_world_box: Matrix | None) -> None:
    """Write down where both hands are on their way to; nothing while the object has not been seen."""
    for side in SIDES:
        aim = None if X_world_box is None else aims.get(side)
        if aim is None or X_world_box is None:
            note_aim(record, side, np.nan, np.nan, np.nan)
            continue
        goal, tips = aim.preshaping_box, aim.tips(X_world_box)
        if goal is None:
            note_aim(record, side, np.nan, np.nan, tips)
        else:
            note_aim(record, side, goal.in_world(X_world_box), goal.half, tips)


def _preshaping_box(X_box_palm: Matrix, box: NominalBox) -> PreshapingBox:
    palm, fingers = _against(X_box_palm[:3, 2]), _against(X_box_palm[:3, 0])
    sections = split(box)
    inside = np.clip(X_box_palm[box.long_axis, 3], sections.stations[0], sections.stations[-1])
    section = min(int(np.searchsorted(sections.cuts, inside)), len(sections.cuts))
    return box_from_component(palm, opposite(fingers), *sections.corners(section))


def _against(direction: Matrix) -> Face:
    return max(FACES, key=lambda face: float(-direction @ face_normal(face)))
