"""Where a held box is shown, handed over and opened: its long axis along y, the opening face to the robot."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from preshape.hal.transform import Matrix, transform
from preshape.hal.world import Face, face_normal

AIR_A = (0.50, -0.10, 0.40)
"""Centre of the box while it is shown, handed over and pushed, m (world)."""
FACING = (-0.79, 0.0, 0.61)
"""Direction that the shown face looks in: to the camera."""


@dataclass(frozen=True, slots=True, eq=False)
class AirPlace:
    """A place in the air: the box's centre (m) and where the shown face looks."""

    center: Matrix = field(default_factory=lambda: np.array(AIR_A))
    facing: Matrix = field(default_factory=lambda: np.array(FACING))


def air_pose(place: AirPlace, gripped_end: Face, facing_face: Face) -> Matrix:
    """Return X_world_box with the gripped end cap at the -y side and a long face looking along `place.facing`.

    `ValueError` unless the two faces are perpendicular.
    """
    end, face = face_normal(gripped_end), face_normal(facing_face)
    if abs(end @ face) > 0.5:
        raise ValueError(f"facing_face: got {facing_face}, allowed is a face perpendicular to {gripped_end}")
    toward_right = np.array([0.0, -1.0, 0.0])
    n = place.facing - (place.facing @ toward_right) * toward_right
    n = n / np.linalg.norm(n)
    box_axes = np.column_stack([face, end, np.cross(face, end)])
    world_axes = np.column_stack([n, toward_right, np.cross(n, toward_right)])
    return transform(place.center, world_axes @ box_axes.T)


def upper_face(X_world_box: Matrix, faces: tuple[Face, ...]) -> Face:
    """Return which of the faces looks up the most."""
    return max(faces, key=lambda face: float((X_world_box[:3, :3] @ face_normal(face))[2]))
