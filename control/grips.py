"""How a hand holds a box by an end cap: where the palm goes, how the fingers wait, in which order they close.

Both grips take the box across two opposite side faces: fingers straight along the one, the thumb on the
other, the palm before the end cap. They were found in physics (see the change log for what they hold).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from preshape.hal.layout import HAND_DOF, Side, finger_slice
from preshape.hal.sah_hand import ACTUATED
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, transform
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
BRACE_Y = 0.0155
"""How far towards the thumb's side the box's middle lies in a brace grip, m."""
GRASP_WIDTHS = (0.070, 0.100)
"""Widths between finger and thumb faces that these grips suit, m."""
CLAMP_WIDTHS = (0.052, 0.066)
"""Widths between fore and ring finger that a cage suits, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """One step of closing: joints that move to angles (nan: stay), joints that are driven to torques (nan: not).

    `touch` asks that every driven joint has met something before the next stage begins.
    """

    angles: Vector
    torques: Vector
    seconds: float
    touch: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Grip:
    """A grip: palm poses in the box's frame (held, and while it comes), finger angles (13) before closing, stages.

    `torques` (13), N m: goals of the driven joints, nan where the joint keeps its angle. `opposed` names the
    pairs of fingers that press against each other: their torques are kept by closing or opening both together.
    `advance` (3,) is the direction, in the palm's frame, in which the hand comes to the object.
    """

    name: str
    side: Side
    X_box_palm: Matrix
    X_box_palm_insert: Matrix
    preshape: Vector
    stages: tuple[Stage, ...]
    torques: Vector
    opposed: tuple[tuple[str, str], ...]
    advance: Vector = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    @property
    def opened(self) -> dict[Side, Vector]:
        """The hand's joint angles (13), rad, when it is open, by its side."""
        return {self.side: self.preshape}


def _joints(**angles: float) -> Vector:
    """Return a hand vector (13), nan but for the named joints."""
    values = np.full(HAND_DOF, np.nan)
    for name, angle in angles.items():
        values[ACTUATED.index(name)] = angle
    return values


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
    R = np.column_stack([x, np.cross(z, x), z])
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
    preshape = _joints(
        thumb_opp=1.5, thumb_abd=-0.26, thumb_flex=-0.069, thumb_pip=0.1,
        fore_abd=0.26 * out["fore"], fore_flex=-0.069, fore_pip=0.07,
        middle_abd=0.0, middle_flex=-0.069, middle_pip=0.07,
        ring_abd=0.26 * out["ring"], ring_flex=-0.069, ring_pip=0.07,
    )  # fmt: skip
    torques = _joints(thumb_flex=0.95, middle_flex=0.5, fore_abd=-0.37 * out["fore"], ring_abd=-0.37 * out["ring"])
    curl = _joints(fore_flex=0.5, fore_pip=0.5, ring_flex=0.5, ring_pip=0.5)
    nothing = _joints()
    stages = (
        Stage(nothing, _joints(thumb_flex=0.3, middle_flex=0.2), 3.0, touch=True),
        Stage(curl, _joints(thumb_flex=0.3, middle_flex=0.2), 0.5),
        Stage(nothing, torques, 4.0),
    )
    return Grip(
        "cage",
        side,
        *_palm(size, end, finger_face, side, FACE_X, 0.0),
        preshape,
        stages,
        torques,
        (("thumb", "middle"), ("fore", "ring")),
    )


def brace_grip(size: Matrix, end: Face, opening_face: Face, side: Side, back_m: float = 0.0) -> Grip:
    """Return the grip that leaves a face free: fore and middle against the thumb, the ring finger behind the box.

    The palm stays `back_m` further from the end cap than usual, where the other hand's fingers lie in the way.
    `ValueError` when the width between the faces beside the opening does not suit the hand.
    """
    n_end, n_open = face_normal(end), face_normal(opening_face)
    if abs(n_end @ n_open) > 0.5:
        raise ValueError(f"opening_face: got {opening_face}, allowed is a face perpendicular to {end}")
    # Left hand: y = -n, z = -n_end, so x = y x z = n x n_end. The right hand's ring lies at -y.
    x = np.cross(n_open, n_end) * (1.0 if side == "left" else -1.0)
    finger_face: Face = max(FACES, key=lambda face: float(face_normal(face) @ -x))
    _check_width(size, finger_face, GRASP_WIDTHS, "width between thumb and fingers")
    out = _outward("ring")
    preshape = _joints(
        thumb_opp=1.5, thumb_abd=-0.1, thumb_flex=-0.069, thumb_pip=0.1,
        fore_abd=0.0, fore_flex=-0.069, fore_pip=0.07,
        middle_abd=0.0, middle_flex=-0.069, middle_pip=0.07,
        ring_abd=0.24 * out, ring_flex=-0.069, ring_pip=0.07,
    )  # fmt: skip
    # The thumb meets the box near its end, opposite the fingers' inner links. What the tips press is a moment that the
    # box gives way to when the other hand lets go: they start light, and the thumb's torque alone tells the squeeze.
    torques = _joints(thumb_flex=1.0, fore_flex=0.25, middle_flex=0.25, ring_abd=-0.5 * out)
    light = _joints(thumb_flex=0.3, fore_flex=0.15, middle_flex=0.15)
    stages = (
        Stage(_joints(), light, 3.0, touch=True),
        Stage(_joints(ring_flex=0.45, ring_pip=0.5), light, 0.5),
        Stage(_joints(), torques, 4.0),
    )
    return Grip(
        "brace",
        side,
        *_palm(size, end, finger_face, side, BRACE_X, BRACE_Y, back_m),
        preshape,
        stages,
        torques,
        (("thumb", "fore"), ("thumb", "middle")),
    )
