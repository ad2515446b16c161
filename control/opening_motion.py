"""The given motions of tasks 4 and 5 as way-points of the right hand in the opening's frame.

Opening frame: origin at the tab's centre on the outer face, x towards the tab's edge (away from the hinge),
z along the outward normal, y = z x x. `toward` is the sign of y on whose side the holding hand lies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preshape.control.contact_policy import Phase
from preshape.hal.layout import HAND_DOF, finger_slice
from preshape.hal.sah_hand import ACTUATED, FOREFINGERS
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, axis_rotation, cross, transform
from preshape.planner.hand_kinematics import hand_kinematics


@dataclass(frozen=True, slots=True, eq=False)
class HandWaypoint:
    """One leg: where the palm goes, the 13 finger angles (rad), how long it takes, what the fingers may press with.

    `phase` is the contact policy's on this leg. `finger_torque` caps the joints of fore, middle and ring finger, N m: a
    lid that stands elsewhere than expected is then pressed gently. `free`: the hand touches nothing when the leg
    begins. `meets`: by its end a finger must have met the opening from outside, opposite the thumb. If none has, the
    legs that follow are led with the fingers `opened` (13), rad, until one says so again: there they close anew.
    """

    name: str
    X_opening_palm: Matrix
    fingers: Vector
    duration_s: float
    finger_torque: float = np.inf
    phase: Phase = Phase.BEFORE_CONTACT
    free: bool = False
    meets: bool = False
    opened: Vector | None = None


FIST = (0.0, 1.13, 1.29)
"""A folded finger's abduction, flexion and middle joint, rad: further in, the fore finger meets the thumb."""


def thumb_out(folded: bool = True) -> Vector:
    """Return the hand with its thumb opposed and straight, the other fingers folded into a fist or straight."""
    q = np.zeros(HAND_DOF)
    q[ACTUATED.index("thumb_opp")], q[ACTUATED.index("thumb_pip")] = 1.55, 0.10
    for finger in FOREFINGERS:
        q[finger_slice(finger)] = FIST if folded else (0.0, -0.069, 0.07)
    return q


def palm_for_tip(p_tip: Matrix, tilt: float, roll: float, toward: float, fingers: Vector) -> Matrix:
    """Return X_opening_palm that puts the thumb's tip at a point.

    The palm's z axis points to the holding hand, tilted by `tilt` (rad) into the face, its x axis (fingers to
    thumb) into the face; `roll` (rad) about the box's long axis takes the thumb under the lid, to the hinge.
    """
    h, n = np.array([0.0, toward, 0.0]), np.array([0.0, 0.0, 1.0])
    z = np.cos(tilt) * h - np.sin(tilt) * n
    x = -np.cos(tilt) * n - np.sin(tilt) * h
    R = np.column_stack([x, cross(z, x), z])
    R = axis_rotation(np.array([0.0, 1.0, 0.0]), roll) @ R
    tip = hand_kinematics("right").tips(fingers)[0][0]
    return transform(np.asarray(p_tip) - R @ tip, R)


AWAY_M = 0.10
"""Height of the thumb's tip above the face before and between, m."""
TILT = float(np.deg2rad(45.0))
"""Tilt of the palm's axis from the box's long axis into the face, rad."""
DEPTH = 0.028
"""How deep the thumb's tip goes, m."""
TIP_X = 0.0
"""Where the thumb comes down, from the tab's centre towards its edge, m.

5 mm towards the edge the tab asks for less, but then the thumb's middle link wedges at the side wall's rim with 2 N.
"""
TIP_Y = 0.011
"""How far towards the holding hand the tip goes, m: the slanted thumb then crosses the face in the hole's middle."""
LEVER_Y = 0.022
"""How far towards the holding hand the thumb leans while it levers, m.

Measured: from 18 to 25 mm all is alike; where the thumb comes down (`TIP_Y`) three boxes of five were crushed (29 to
36 N) and slid by 6 to 8 mm.
"""
PINCH_Y = 0.015
"""How far towards the holding hand the thumb stands while the lid rests on it and is pinched, m."""
PINCH_TORQUE = 0.25
"""What a finger joint may press the lid with, N m: some 2 N at the tip."""
HINGE_ROOM = 0.020
"""Half the tab's depth: the lid begins this far from the tab's centre towards the hinge, m."""


def push_motion(toward: float) -> tuple[HandWaypoint, ...]:
    """Return task 4: the thumb comes down on the tab, pushes it in, and leaves the way it came."""
    fist = thumb_out()

    def at(z: float) -> Matrix:
        return palm_for_tip(np.array([TIP_X, toward * TIP_Y, z]), TILT, 0.0, toward, fist)

    return (
        HandWaypoint("above", at(AWAY_M), fist, 0.3),
        HandWaypoint("touch", at(0.02), fist, 0.6, free=True),
        HandWaypoint("crush", at(-DEPTH), fist, 1.6),
        HandWaypoint("leave", at(0.06), fist, 0.8, phase=Phase.AFTER_CONTACT),
        HandWaypoint("clear", at(AWAY_M), fist, 0.5, free=True),
    )


def open_motion(
    toward: float, hinge_distance: float, turn: float = float(np.deg2rad(80.0))
) -> tuple[HandWaypoint, ...]:
    """Return task 5: insert the thumb, lever the lid loose, pinch it, turn it open about its hinge, leave.

    The lever rolls the thumb about the rim of the side wall until it presses the lid from within: the forces on
    rim and lid are nearly a couple, which the holding hand bears far better than a pull. `hinge_distance` is the
    distance of the hinge from the tab's centre, m. After the pinch the hand turns rigidly with the lid.
    """
    fist, curl = thumb_out(), _hook(0.80, FIST[2])
    hook, pinch = _hook(0.70, 0.60), _hook(0.45, 0.50)

    def at(x: float, z: float, roll_deg: float, y: float = TIP_Y) -> Matrix:
        return palm_for_tip(np.array([x, toward * y, z]), TILT, float(np.deg2rad(roll_deg)), toward, fist)

    inside = Phase.AFTER_CONTACT
    rise = -HINGE_ROOM - 0.003, 0.012, 20.0
    loose = [
        HandWaypoint("above", at(TIP_X, AWAY_M, 0.0), fist, 0.3),
        HandWaypoint("enter", at(TIP_X, 0.02, 0.0), fist, 0.6, free=True),
        HandWaypoint("insert", at(TIP_X, -DEPTH, 0.0), fist, 1.2),
        HandWaypoint("lean", at(TIP_X, -DEPTH, 0.0, LEVER_Y), fist, 0.6, phase=inside),
        HandWaypoint("lever", at(-0.028, -0.028, 45.0, LEVER_Y), fist, 1.2, phase=inside),
        HandWaypoint("tear", at(-0.031, -0.020, 53.0, LEVER_Y), fist, 1.0, phase=inside),
        HandWaypoint("raise", at(*rise, PINCH_Y), fist, 1.0, phase=inside),
        HandWaypoint("hook", at(*rise, PINCH_Y), hook, 0.6, PINCH_TORQUE, Phase.PINCH, free=True),
        HandWaypoint("pinch", at(*rise, PINCH_Y), pinch, 0.6, PINCH_TORQUE, Phase.PINCH, meets=True),
    ]
    X_rise, steps = at(*rise, PINCH_Y), 8
    turned = [_about_hinge(X_rise, hinge_distance, turn * (k + 1) / steps) for k in range(steps)]
    turns = [
        HandWaypoint("turn", X, pinch, 0.35, PINCH_TORQUE, Phase.PINCH, meets=X is turned[-1], opened=fist)
        for X in turned
    ]
    X_end = turned[-1]
    u = X_end[:3, :3] @ hand_kinematics("right").tip_poses(fist)[0][:3, 0]
    leave = [
        HandWaypoint("let go", X_end, _hook(0.85, 0.8), 0.5, phase=Phase.PINCH),
        HandWaypoint("curl", X_end, curl, 0.5, phase=inside),
        HandWaypoint("fold", X_end, fist, 0.4, phase=inside),
        HandWaypoint("withdraw", transform(-0.05 * u) @ X_end, fist, 0.8, phase=inside),
        HandWaypoint("leave", transform(-0.12 * u) @ X_end, fist, 0.8, free=True),
    ]
    return (*loose, *turns, *leave)


def _hook(flex: float, pip: float) -> Vector:
    """Return the thumb opposed and fore and middle bent over the lid, the ring folded."""
    q = thumb_out()
    for finger in ("fore", "middle"):
        q[finger_slice(finger)] = (0.0, flex, pip)
    return q


def _about_hinge(X_opening_palm: Matrix, hinge_distance: float, angle: float) -> Matrix:
    """Return a palm pose turned with the lid by an angle (rad) about its hinge; positive opens."""
    hinge = transform((-hinge_distance, 0.0, 0.0))
    turn = transform(R=axis_rotation(np.array([0.0, -1.0, 0.0]), angle))
    return hinge @ turn @ transform((hinge_distance, 0.0, 0.0)) @ X_opening_palm
