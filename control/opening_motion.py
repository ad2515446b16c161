"""The given motions of tasks 4 and 5 as way-points of the right hand in the opening's frame.

Opening frame: origin at the tab's centre on the outer face, x towards the tab's edge (away from the hinge),
z along the outward normal, y = z x x. `toward` is the sign of y on whose side the holding hand lies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preshape.hal.layout import HAND_DOF, finger_slice
from preshape.hal.sah_hand import ACTUATED, FOREFINGERS
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, axis_rotation, transform
from preshape.planner.hand_kinematics import hand_kinematics


@dataclass(frozen=True, slots=True, eq=False)
class HandWaypoint:
    """One leg: where the palm goes, the 13 finger angles (rad), how long it takes, and which joints are driven to torques.

    `torque_goal` (13), N m: nan where the joint keeps its angle.
    """

    name: str
    X_opening_palm: Matrix
    fingers: Vector
    duration_s: float
    torque_goal: Vector | None = None


def thumb_out(folded: bool = True) -> Vector:
    """Return the hand with its thumb opposed and straight, the other fingers folded into a fist or straight."""
    q = np.zeros(HAND_DOF)
    q[ACTUATED.index("thumb_opp")], q[ACTUATED.index("thumb_pip")] = 1.55, 0.10
    for finger in FOREFINGERS:
        q[finger_slice(finger)] = (0.0, 1.25, 1.25) if folded else (0.0, -0.069, 0.07)
    return q


def palm_for_tip(p_tip: Matrix, tilt: float, roll: float, toward: float, fingers: Vector) -> Matrix:
    """Return X_opening_palm that puts the thumb's tip at a point.

    The palm's z axis points to the holding hand, tilted by `tilt` (rad) into the face, its x axis (fingers to
    thumb) into the face; `roll` (rad) about the box's long axis takes the thumb under the lid, to the hinge.
    """
    h, n = np.array([0.0, toward, 0.0]), np.array([0.0, 0.0, 1.0])
    z = np.cos(tilt) * h - np.sin(tilt) * n
    x = -np.cos(tilt) * n - np.sin(tilt) * h
    R = np.column_stack([x, np.cross(z, x), z])
    R = axis_rotation(np.array([0.0, 1.0, 0.0]), roll) @ R
    tip = hand_kinematics("right").tips(fingers)[0][0]
    return transform(np.asarray(p_tip) - R @ tip, R)


PUSH_TILT = np.deg2rad(45.0)
PUSH_DEPTH = 0.028


def push_motion(toward: float) -> tuple[HandWaypoint, ...]:
    """Return task 4: the thumb comes down on the tab, pushes it in, and leaves the way it came."""
    q = thumb_out()
    at = lambda z: palm_for_tip(np.array([0.007, 0.0, z]), PUSH_TILT, 0.0, toward, q)  # noqa: E731
    return (
        HandWaypoint("above", at(0.08), q, 0.3),
        HandWaypoint("touch", at(0.02), q, 0.6),
        HandWaypoint("crush", at(-PUSH_DEPTH), q, 1.6),
        HandWaypoint("leave", at(0.10), q, 0.8),
        HandWaypoint("clear", at(0.14), q, 0.4),
    )
