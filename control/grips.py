"""How a hand holds a box by an end cap: where the palm goes, how the fingers wait, in which order they close.

Both grips take the box across two opposite side faces: fingers straight along the one, the thumb on the
other, the palm before the end cap. Where the palm goes was found in physics (see the change log); the torques are
those of internal forces.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from preshape.control.grip import LIGHT_SHARE, Grip, Stage, joints
from preshape.control.internal_forces import squeezed
from preshape.hal.layout import HAND_DOF, Side, finger_slice
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, cross, transform
from preshape.hal.world import FACES, Face, face_normal
from preshape.planner.hand_kinematics import hand_kinematics

FACE_X = 0.014
"""Distance along palm x of the finger-side face from the palm's origin, m: fingers lie along it, straight."""
BRACE_X = 0.012
"""The same in a brace grip, m: the fingers' inner links lie on the face as well as their tips.

Where only the tips do, the box turns about the thumb until the inner links meet it, as soon as it is held by this
hand alone.
"""
INSERT_X = 0.021
"""The same while the hand comes: the box's middle between fingers and thumb, m."""
CAP_Z = 0.176
"""Distance along palm z of the end cap from the palm's origin, m."""
SPARE_M = 0.010
"""How far a palm stays back when both hands have straight fingers on the same face: their tips would meet, m."""
RING_NM = 0.5
"""Torque of a brace's ring finger, N m: it stands behind the box against what pushes at the opening."""
BRACE_Y = 0.0155
"""How far towards the thumb's side the box's middle lies in a brace grip, m."""
GRASP_WIDTHS = (0.070, 0.100)
"""Widths between finger and thumb faces that these grips suit, m."""
CLAMP_WIDTHS = (0.052, 0.062)
"""Widths between fore and ring finger that a cage suits, m: curled, these spread no further."""


def _outward(finger: str) -> float:
    """Return the sign of a finger's abduction that moves its tip away from the middle finger."""
    kinematics = hand_kinematics("right")
    q = np.clip(np.zeros(HAND_DOF), kinematics.lower, kinematics.upper)
    tip = {"fore": 1, "ring": 3}[finger]
    moved = q.copy()
    moved[finger_slice(finger).start] += 0.1
    before, after = (abs(kinematics.tips(angles)[0][tip, 1]) for angles in (q, moved))
    return 1.0 if after > before else -1.0


def _palm(
    size: Matrix, end: Face, finger_face: Face, side: Side, face_x: float, across_y: float, back_m: float = 0.0
) -> tuple[Matrix, Matrix]:
    """Return X_box_palm held and while it comes: z into the box, x from the finger face to the thumb's."""
    half = np.asarray(size, float) / 2
    n_end, n_finger = face_normal(end), face_normal(finger_face)
    x, z = -n_finger, -n_end
    R = np.column_stack([x, cross(z, x), z])
    mirror = 1.0 if side == "right" else -1.0
    poses: list[Matrix] = []
    for at_x in (face_x, INSERT_X):
        p_palm_box = np.array([at_x + np.abs(x) @ half, mirror * across_y, CAP_Z + back_m + np.abs(z) @ half])
        poses.append(transform(-R @ p_palm_box, R))
    return poses[0], poses[1]


def _check_width(size: Matrix, face: Face, widths: tuple[float, float], what: str) -> None:
    width = float(np.abs(face_normal(face)) @ np.asarray(size, float))
    if not widths[0] <= width <= widths[1]:
        raise ValueError(f"{what}: got {width:g} m, allowed is {widths[0]:g} .. {widths[1]:g} m")


def cage_grip(size: Matrix, end: Face, finger_face: Face, side: Side) -> Grip:
    """Return the four-sided grip: middle finger against thumb, fore and ring clamping the faces beside.

    `ValueError` when a width does not suit the hand.
    """
    _check_width(size, finger_face, GRASP_WIDTHS, "width between thumb and middle finger")
    beside: Face = next(f for f in FACES if f[1] not in (end[1], finger_face[1]))
    _check_width(size, beside, CLAMP_WIDTHS, "width between fore and ring finger")
    out = {finger: _outward(finger) for finger in ("fore", "ring")}
    preshape = joints(
        thumb_opp=1.5, thumb_abd=-0.26, thumb_flex=-0.069, thumb_pip=0.1,
        fore_abd=0.26 * out["fore"], fore_flex=-0.069, fore_pip=0.07,
        middle_abd=0.0, middle_flex=-0.069, middle_pip=0.07,
        ring_abd=0.26 * out["ring"], ring_flex=-0.069, ring_pip=0.07,
    )  # fmt: skip
    press = joints(thumb_flex=1.0, middle_flex=1.0, fore_abd=-out["fore"], ring_abd=-out["ring"])
    light = LIGHT_SHARE * joints(thumb_flex=1.0, middle_flex=1.0)
    curl = joints(fore_flex=0.5, fore_pip=0.5, ring_flex=0.5, ring_pip=0.5)
    nothing = joints()
    stages = (
        Stage(nothing, light, 3.0, touch=True),
        Stage(curl, light, 0.5),
        Stage(nothing, press, 4.0),
    )
    shape = Grip(
        "cage",
        side,
        *_palm(size, end, finger_face, side, FACE_X, 0.0),
        preshape,
        stages,
        press,
        (("thumb", "middle"), ("fore", "ring")),
    )
    return squeezed(shape, size)


def brace_grip(size: Matrix, end: Face, opening_face: Face, side: Side, back_m: float = 0.0) -> Grip:
    """Return the grip that leaves a face free: fore and middle against the thumb, the ring finger behind the box.

    The palm stays `back_m` further from the end cap than usual, where the other hand's fingers lie in the way.
    `ValueError` when the width between the faces beside the opening does not suit the hand.
    """
    n_end, n_open = face_normal(end), face_normal(opening_face)
    if abs(n_end @ n_open) > 0.5:
        raise ValueError(f"opening_face: got {opening_face}, allowed is a face perpendicular to {end}")
    # Left hand: y = -n, z = -n_end, so x = y x z = n x n_end. The right hand's ring lies at -y.
    x = cross(n_open, n_end) * (1.0 if side == "left" else -1.0)
    finger_face: Face = max(FACES, key=lambda face: float(face_normal(face) @ -x))
    _check_width(size, finger_face, GRASP_WIDTHS, "width between thumb and fingers")
    out = _outward("ring")
    preshape = joints(
        thumb_opp=1.5, thumb_abd=-0.1, thumb_flex=-0.069, thumb_pip=0.1,
        fore_abd=0.0, fore_flex=-0.069, fore_pip=0.07,
        middle_abd=0.0, middle_flex=-0.069, middle_pip=0.07,
        ring_abd=0.24 * out, ring_flex=-0.069, ring_pip=0.07,
    )  # fmt: skip
    press = joints(thumb_flex=1.0, fore_flex=1.0, middle_flex=1.0)
    nothing, light = joints(), LIGHT_SHARE * press
    stages = (
        Stage(nothing, light, 3.0, touch=True),
        Stage(joints(ring_flex=0.45, ring_pip=0.5), light, 0.5),
        Stage(nothing, press, 4.0),
    )
    shape = Grip(
        "brace",
        side,
        *_palm(size, end, finger_face, side, BRACE_X, BRACE_Y, back_m),
        preshape,
        stages,
        press,
        (("thumb", "fore"), ("thumb", "middle")),
    )
    return _backed(squeezed(shape, size), joints(ring_abd=-RING_NM * out))


def _backed(grip: Grip, behind: Vector) -> Grip:
    """Return a grip that also drives joints which have no part in its squeeze, in its last stage, to torques (13)."""

    def both(torques: Vector) -> Vector:
        return np.where(np.isfinite(behind), behind, torques)

    last = grip.stages[-1]
    stages = (*grip.stages[:-1], replace(last, torques=both(last.torques)))
    return replace(grip, stages=stages, torques=both(grip.torques))
