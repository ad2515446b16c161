"""One way to take hold of a part: a component with the thumb on one of its faces, its preshaping box, its preshape."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from preshape.hal import sah_hand
from preshape.hal.layout import Side, finger_slice
from preshape.hal.transform import Matrix
from preshape.hal.world import Face
from preshape.planner.component import Component
from preshape.planner.finger_count import TIP_SIDE, fingers_for, tip_targets
from preshape.planner.force_closure import ForceClosure, force_closure
from preshape.planner.grasping_plane import grasping_plane
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.planner.preshape_qp import PreshapeProblem, PreshapeResult, solve
from preshape.planner.preshaping_box import PreshapingBox
from preshape.planner.sections import Sections
from preshape.planner.work_object import WorkPart

SOFT_TIP_M = 0.003
"""Moment about its normal that a fingertip bears over its normal force, m."""

_DIGITS = 6


@dataclass(frozen=True, slots=True, eq=False)
class GraspOption:
    """A component, a face for the thumb, and the preshape that goes with them.

    Attributes:
        component: palm patch and pair of grasped patches, on `part`.
        side: the hand.
        box: the preshaping box, in the part's frame.
        fingers: which fingers touch, thumb first.
        tips: desired fingertips p_fid of eq. (4) in the PB's frame (n, 3), m.
        preshape: the answer of eq. (5); its "world" is the preshaping box.
        X_object_pb: pose of the preshaping box in the object's frame.
        X_object_palm: pose of the palm at the preshape in the object's frame.
    """

    part: WorkPart
    component: Component
    side: Side
    box: PreshapingBox
    fingers: tuple[str, ...]
    tips: Matrix
    preshape: PreshapeResult
    X_object_pb: Matrix
    X_object_palm: Matrix

    @property
    def palm_face(self) -> Face:
        """The part's face before the palm."""
        return self.box.palm_face

    @property
    def finger_face(self) -> Face:
        """The part's face for the fingers."""
        return self.box.finger_face

    @property
    def thumb_face(self) -> Face:
        """The part's face for the thumb."""
        return self.box.thumb_face

    @property
    def closure(self) -> ForceClosure:
        """Both force-closure tests of the fingertips laid on the faces."""
        flat = tuple(round(float(v), _DIGITS) for p in self._touching() for v in p)
        return _closure(self.side, flat, self.part.box.friction_range[0])

    @property
    def q_hand(self) -> Matrix:
        """Finger joints (13) at the preshape, rad."""
        return self.preshape.joints

    @property
    def tips_object(self) -> Matrix:
        """Desired fingertips (n, 3) in the object's frame, m."""
        return self.tips @ self.X_object_pb[:3, :3].T + self.X_object_pb[:3, 3]

    @property
    def contacts_object(self) -> Matrix:
        """Where the fingertips will touch the part (n, 3), in the object's frame, m."""
        return self._touching() @ self.X_object_pb[:3, :3].T + self.X_object_pb[:3, 3]

    def _touching(self) -> Matrix:
        """Return the contacts in the PB's frame."""
        touching = self.tips.copy()
        touching[:, 0] -= np.sign(touching[:, 0]) * (TIP_SIDE + self.box.margin)
        return touching

    def reached_plane(self) -> Matrix:
        """Return X_object_gp: the grasping plane that the preshape's fingertips really span."""
        index = [sah_hand.FINGERS.index(finger) for finger in self.fingers]
        X = self.X_object_palm
        tips = hand_kinematics(self.side).tips(self.q_hand)[0][index] @ X[:3, :3].T + X[:3, 3]
        return grasping_plane(tips, self.side, self.X_object_pb[:3, 1])

    def __str__(self) -> str:
        return f"{self.component}, thumb {self.thumb_face}"


def grasp_options(
    part: WorkPart, sections: Sections, component: Component, side: Side, q_hand: Matrix
) -> tuple[GraspOption, GraspOption]:
    """Return both options of a component, thumb on either face; `q_hand` (13) are the finger joints of x_n, rad."""
    first, second = component.preshaping_boxes(*sections.corners(component.section))
    return _option(part, component, side, first, q_hand), _option(part, component, side, second, q_hand)


def _option(part: WorkPart, component: Component, side: Side, box: PreshapingBox, q_hand: Matrix) -> GraspOption:
    fingers = fingers_for(box.half)
    half = _rounded(box.half)
    preshape = _preshape(side, half, fingers, _rounded(_spare_fingers_straight(side, fingers, q_hand)))
    tips, X_object_pb = tip_targets(box.half, fingers, side), part.X_object_part @ box.X_object_pb
    X_object_palm = X_object_pb @ preshape.X_pb_palm
    return GraspOption(part, component, side, box, fingers, tips, preshape, X_object_pb, X_object_palm)


def _spare_fingers_straight(side: Side, fingers: tuple[str, ...], q_hand: Matrix) -> Matrix:
    """Return x_n with the fingers that take no part stretched out: bent ones would meet the object."""
    lower = hand_kinematics(side).lower
    joints = np.array(q_hand)
    for finger in sah_hand.FINGERS:
        if finger not in fingers:
            own = finger_slice(finger)
            joints[own.start + 1 : own.stop] = lower[own.start + 1 : own.stop]
    return joints


def _rounded(values: Matrix) -> tuple[float, ...]:
    return tuple(round(float(v), _DIGITS) for v in values)


@lru_cache(maxsize=1024)
def _preshape(
    side: Side, half: tuple[float, ...], fingers: tuple[str, ...], q_hand: tuple[float, ...]
) -> PreshapeResult:
    """Solve in the preshaping box's frame: where the box stands does not matter."""
    found = solve(PreshapeProblem(side, np.eye(4), np.array(half), np.array(q_hand), fingers))
    found.joints.setflags(write=False)
    return found


@lru_cache(maxsize=1024)
def _closure(side: Side, contacts: tuple[float, ...], friction: float) -> ForceClosure:
    """Judge fingertips at contacts (3 n numbers, in the PB's frame: thumb at +x, the others at -x)."""
    points = np.array(contacts).reshape(-1, 3)
    normals = np.zeros_like(points)
    normals[:, 0] = -np.sign(points[:, 0])
    return force_closure(points, points, normals, friction, side, SOFT_TIP_M)
