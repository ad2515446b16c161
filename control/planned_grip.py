"""A planned grasp option as a grip: the preshape of eq. (5), then closing along the internal forces."""

from __future__ import annotations

import numpy as np

from preshape.control.grip import LIGHT_SHARE, Grip, Stage, joints
from preshape.control.grip_contacts import Contacts
from preshape.control.internal_forces import pressed
from preshape.hal.sah_hand import FINGERS
from preshape.hal.transform import inverse
from preshape.planner.grasp_option import GraspOption
from preshape.planner.hand_kinematics import hand_kinematics


def option_contacts(option: GraspOption) -> Contacts:
    """Return where the fingertips of an option will touch its part, in the preshaping box's frame.

    The thumb presses along the box's x axis from its face, the others against it from theirs.
    """
    X_pb_palm = inverse(option.X_object_pb) @ option.X_object_palm
    jacobians = X_pb_palm[:3, :3] @ hand_kinematics(option.side).tips(option.q_hand)[1]
    points = (option.contacts_object - option.X_object_pb[:3, 3]) @ option.X_object_pb[:3, :3]
    normals = np.zeros_like(points)
    normals[:, 0] = -np.sign(points[:, 0])
    return Contacts(
        points,
        normals,
        jacobians[[FINGERS.index(finger) for finger in option.fingers]],
        tuple(f"{finger}_dist" for finger in option.fingers),
        np.array(option.q_hand),
    )


def planned_grip(option: GraspOption) -> Grip:
    """Return the grip of an option: each finger that touches closes by its flexion, the others stay where they are.

    The hand comes along the normal of the palm's face, which the palm itself may be tilted against.
    """
    press, nothing = joints(**{f"{finger}_flex": 1.0 for finger in option.fingers}), joints()
    shape = Grip(
        "planned",
        option.side,
        option.X_object_palm,
        option.X_object_palm,
        np.array(option.q_hand),
        (Stage(nothing, LIGHT_SHARE * press, 3.0, touch=True), Stage(nothing, press, 2.5)),
        press,
        tuple(("thumb", finger) for finger in option.fingers[1:]),
        option.X_object_palm[:3, :3].T @ option.X_object_pb[:3, 2],
    )
    return pressed(shape, option_contacts(option))
