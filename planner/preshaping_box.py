"""The preshaping box (PB) of section III-C: three faces of a component made into one box with its own frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.transform import Matrix, cross, transform
from preshape.hal.world import Face, face_normal, opposite

MARGIN = 0.012
"""Default distance by which each of both preshape faces moves away from the object, m."""

FINGER_REACH = 0.040
"""Default depth below the palm face beyond which fingertips are not put, m."""


def _frozen(values: ArrayLike) -> Matrix:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True, eq=False)
class PreshapingBox:
    """Where palm, thumb and fingers go before a grasp.

    `X_object_pb`: z = normal of the palm face, from the palm to the face; x = normal of the preshape faces,
    from the fingers' face to the thumb's; origin at the centre. `half`: half edges along these axes, m; x
    already holds `margin` (m) on both sides. The fingertips' surfaces belong on the faces x = +-half[0].
    """

    palm_face: Face
    thumb_face: Face
    finger_face: Face
    X_object_pb: Matrix
    half: Matrix
    margin: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "X_object_pb", _frozen(self.X_object_pb))
        object.__setattr__(self, "half", _frozen(self.half))
        if self.half.shape != (3,) or not np.all(self.half > 0):
            raise ValueError(f"half edges of a preshaping box must be 3 positive lengths, got {self.half.tolist()} m")

    @property
    def grasped_width(self) -> float:
        """Distance between both grasped faces of the object, m."""
        return float(2.0 * (self.half[0] - self.margin))

    @property
    def depth(self) -> float:
        """Depth of the fingertips below the object's palm face, m."""
        return float(self.half[2])

    def in_world(self, X_world_object: Matrix) -> Matrix:
        """Return X_world_pb."""
        return X_world_object @ self.X_object_pb


@cache
def _axes(palm_face: Face, thumb_face: Face) -> Matrix:
    x, z = face_normal(thumb_face), -face_normal(palm_face)
    return _frozen(np.column_stack([x, cross(z, x), z]))


def box_from_component(
    palm_face: Face,
    thumb_face: Face,
    lower: ArrayLike,
    upper: ArrayLike,
    margin: float = MARGIN,
    reach: float = FINGER_REACH,
) -> PreshapingBox:
    """Return the PB of a component: palm on one face of a section, thumb and fingers on an opposite pair of others.

    Args:
        palm_face: the object's face towards the palm.
        thumb_face: the face for the thumb; the fingers get the opposite one.
        lower: smallest coordinates of the section in the object's frame (3,), m.
        upper: largest coordinates of the section, m.
        margin: expansion of x on each side, m; y and z do not change by it.
        reach: greatest depth of the fingertips, m: a longer z edge is cut to twice this, at the palm's end.

    Raises:
        ValueError: palm and thumb faces on one axis, an empty section, a negative margin, a reach that is not positive.
    """
    lower, upper = _frozen(lower), _frozen(upper)
    if palm_face[1] == thumb_face[1]:
        raise ValueError(f"palm face {palm_face} and thumb face {thumb_face} must be on different axes")
    if not np.all(upper > lower):
        raise ValueError(f"a section needs upper > lower on every axis, got {lower.tolist()} and {upper.tolist()} m")
    if margin < 0 or reach <= 0:
        raise ValueError(f"margin must be >= 0 and reach > 0, got {margin} m and {reach} m")
    R = _axes(palm_face, thumb_face)
    half = np.abs(R.T) @ (upper - lower) / 2.0
    near = R.T @ (lower + upper) / 2.0 - [0.0, 0.0, half[2]]
    half[2] = min(half[2], reach)
    half[0] += margin
    return PreshapingBox(
        palm_face, thumb_face, opposite(thumb_face), transform(R @ (near + [0.0, 0.0, half[2]]), R), half, margin
    )
