"""How the right hand takes a lying box from above: fingers down one long side, thumb down the other.

The thumb is shorter than the fingers. The palm therefore leans towards the thumb by `TILT` about its y axis,
which runs along the box: so both kinds of tips reach down equally far and stay clear of the table.
"""

from __future__ import annotations

import numpy as np

from preshape.control.grip import LIGHT_SHARE, Grip, Stage, joints
from preshape.control.internal_forces import squeezed
from preshape.hal.transform import Matrix, cross, transform
from preshape.hal.world import Face, face_normal

TILT = np.deg2rad(29.0)
"""Lean of the palm towards the thumb, rad."""
PALM_X = 0.043
"""Palm's origin from the box's middle towards the thumb's side, m."""
PALM_Z = 0.277
"""Palm's origin above the table, m."""
TOWARDS_END = 0.025
"""Palm's origin from the box's middle towards the end that will be up, m."""
WIDTHS = (0.080, 0.096)
"""Widths between the side faces that the open hand goes around and the closing hand meets, m."""
HEIGHTS = (0.050, 0.064)
"""Heights of the lying box: the pads meet the sides 30 mm above the table, the palm's side stays above the box, m."""


def _check(what: str, value: float, allowed: tuple[float, float]) -> None:
    if not allowed[0] <= value <= allowed[1]:
        raise ValueError(f"{what}: got {value:g} m, allowed is {allowed[0]:g} .. {allowed[1]:g} m")


def straddle_pose(size: Matrix, up: Face, finger_face: Face, end: Face) -> Matrix:
    """Return X_box_palm over a lying box whose face `up` looks up; `end` is the end cap that will be up later.

    `ValueError` unless the three faces are perpendicular to each other.
    """
    if len({up[1], finger_face[1], end[1]}) != 3:
        raise ValueError(f"faces: got {up}, {finger_face}, {end}, allowed are three perpendicular ones")
    n_up, n_finger, n_end = (face_normal(face) for face in (up, finger_face, end))
    z, x = -n_up, -n_finger
    tilted_x = np.cos(TILT) * x + np.sin(TILT) * z
    tilted_z = np.cos(TILT) * z - np.sin(TILT) * x
    half_height = float(np.abs(n_up) @ np.asarray(size, float)) / 2
    R = np.column_stack([tilted_x, cross(tilted_z, tilted_x), tilted_z])
    return transform(x * PALM_X + n_up * (PALM_Z - half_height) + n_end * TOWARDS_END, R)


def straddle_grip(size: Matrix, up: Face, finger_face: Face, end: Face) -> Grip:
    """Return the right hand's grip of a lying box across its two long sides; see `straddle_pose` for the faces.

    `ValueError` names a width or height that does not suit the hand.
    """
    size = np.asarray(size, float)
    _check("width between thumb and fingers", float(np.abs(face_normal(finger_face)) @ size), WIDTHS)
    _check("height of the lying box", float(np.abs(face_normal(up)) @ size), HEIGHTS)
    X_box_palm = straddle_pose(size, up, finger_face, end)
    preshape = {"thumb_opp": 1.571, "thumb_abd": -0.22, "thumb_flex": -0.069, "thumb_pip": 0.076}
    for finger in ("fore", "middle", "ring"):
        preshape |= {f"{finger}_abd": 0.0, f"{finger}_flex": -0.069, f"{finger}_pip": 0.363}
    nothing, press = joints(), joints(thumb_flex=1.0, fore_flex=1.0, middle_flex=1.0, ring_flex=1.0)
    shape = Grip(
        "straddle",
        "right",
        X_box_palm,
        X_box_palm,
        joints(**preshape),
        (Stage(nothing, LIGHT_SHARE * press, 3.0, touch=True), Stage(nothing, press, 2.5)),
        press,
        (("thumb", "fore"), ("thumb", "middle"), ("thumb", "ring")),
    )
    return squeezed(shape, size)
