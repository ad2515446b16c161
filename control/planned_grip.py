"""A planned grasp option as a grip: the preshape of eq. (5), then closing along the internal forces."""

from __future__ import annotations

import numpy as np

from preshape.control.grips import Grip, Stage
from preshape.hal import sah_hand
from preshape.hal.layout import HAND_DOF, LAYOUT
from preshape.hal.sah_hand import ACTUATED
from preshape.hal.state import Vector
from preshape.planner.grasp_option import GraspOption
from preshape.planner.hand_kinematics import hand_kinematics

MOST_SQUEEZE_N = 10.0
"""Force of the thumb, and of the other fingers together, that no panel minds, N."""
JOINT_SHARE = 0.8
"""Share of its torque limit that the squeeze may ask of any joint that bears it."""
LIGHT_SHARE = 0.3
"""Share of the squeeze with which the fingers feel for the object."""


def levers(option: GraspOption) -> dict[str, Vector]:
    """Return for each finger that touches the torques (13) that a force of 1 N into the object asks, m.

    tau = J^T n at the fingertip, with n the direction from the finger's preshape face to the other one.
    """
    jacobians = hand_kinematics(option.side).tips(option.q_hand)[1]
    x = option.X_object_palm[:3, :3].T @ option.X_object_pb[:3, 0]
    return {
        finger: (-x if finger == "thumb" else x) @ jacobians[sah_hand.FINGERS.index(finger)]
        for finger in option.fingers
    }


def squeeze_torques(option: GraspOption) -> Vector:
    """Return the torques (13), N m, of the strongest squeeze that joints and panels allow; 0 where nothing bears it.

    The thumb presses with f, the n others with f / n each: f = min(f_max, share tau_limit / |tau_1N|).
    """
    per_newton = np.zeros(HAND_DOF)
    for finger, torques in levers(option).items():
        per_newton += torques if finger == "thumb" else torques / (len(option.fingers) - 1)
    limit = LAYOUT.torque[LAYOUT.hand(option.side)]
    bearing = np.abs(per_newton) > 1e-6
    squeeze = min(MOST_SQUEEZE_N, float(np.min(JOINT_SHARE * limit[bearing] / np.abs(per_newton[bearing]))))
    return squeeze * per_newton


def planned_grip(option: GraspOption) -> Grip:
    """Return the grip of an option: each finger that touches closes by its flexion, the others stay where they are.

    The hand comes along the normal of the palm's face, which the palm itself may be tilted against.
    """
    torques = squeeze_torques(option)
    driven = np.array([name in {f"{finger}_flex" for finger in option.fingers} for name in ACTUATED])
    goal = np.where(driven, torques, np.nan)
    nothing = np.full(HAND_DOF, np.nan)
    return Grip(
        "planned",
        option.side,
        option.X_object_palm,
        option.X_object_palm,
        np.array(option.q_hand),
        (Stage(nothing, LIGHT_SHARE * goal, 3.0, touch=True), Stage(nothing, goal, 2.5)),
        goal,
        tuple(("thumb", finger) for finger in option.fingers[1:]),
        option.X_object_palm[:3, :3].T @ option.X_object_pb[:3, 2],
    )
