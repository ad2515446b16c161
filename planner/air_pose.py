"""Where a held box is shown, handed over and opened: its long axis along y, the opening face to the robot."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from preshape.hal.transform import Matrix, cross, transform
from preshape.hal.world import Face, face_normal

AIR_A = (0.50, -0.10, 0.40)
"""Centre of the box while it is shown, handed over and pushed, m (world)."""
ELSEWHERE = (
    (0.0, 0.0, 0.0), (0.0, -0.08, 0.0), (0.0, 0.0, 0.08), (-0.08, 0.0, 0.0), (0.0, 0.0, -0.08), (0.08, 0.0, 0.0),
)  # fmt: skip
"""Where a box is held in the air, from the place meant for it, m: elsewhere only if an obstacle is in the way."""
FACING = (-0.79, 0.0, 0.61)
"""Direction that the shown face looks in: to the camera."""


@dataclass(frozen=True, slots=True, eq=False)
class AirPlace:
    """A place in the air: the box's centre (m), where the shown face and the right hand's end cap look."""

    center: Matrix = field(default_factory=lambda: np.array(AIR_A))
    facing: Matrix = field(default_factory=lambda: np.array(FACING))
    toward_right: Matrix = field(default_factory=lambda: np.array([0.0, -1.0, 0.0]))


def air_pose(place: AirPlace, gripped_end: Face, facing_face: Face) -> Matrix:
    """Return X_world_box with the gripped end cap and a long face looking where the place says.

    The end cap looks exactly along `place.toward_right`, the face along what `place.facing` leaves across it.

    `ValueError` unless the two faces are perpendicular.
    """
    end, face = face_normal(gripped_end), face_normal(facing_face)
    if abs(end @ face) > 0.5:
        raise ValueError(f"facing_face: got {facing_face}, allowed is a face perpendicular to {gripped_end}")
    toward_right = place.toward_right
    n = place.facing - (place.facing @ toward_right) * toward_right
    n = n / np.linalg.norm(n)
    box_axes = np.column_stack([face, end, cross(face, end)])
    world_axes = np.column_stack([n, toward_right, cross(n, toward_right)])
    return transform(place.center, world_axes @ box_axes.T)


def open_places() -> tuple[AirPlace, ...]:
    """Return places for a box that the left hand holds while the right hand opens it, the roomiest first.

    Found by ranking a grid of places by the score of the right arm's worst posture through push and opening:
    near the robot, the free end turned to it, and the opening rather up, so that the elbow stays low.
    """
    places: list[AirPlace] = []
    for elevation_deg in (80.0, 60.0, 95.0, 40.0):
        for yaw_deg in (-40.0, -25.0, -55.0):
            for x in (0.42, 0.48):
                for y in (-0.05, 0.05):
                    for z in (0.45, 0.38):
                        elevation, yaw = np.deg2rad(elevation_deg), np.deg2rad(yaw_deg)
                        Rz = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1.0]])
                        facing = Rz @ np.array([-np.cos(elevation), 0.0, np.sin(elevation)])
                        places.append(AirPlace(np.array([x, y, z]), facing, Rz @ np.array([0.0, -1.0, 0.0])))
    return tuple(places)


def upper_face(X_world_box: Matrix, faces: tuple[Face, ...]) -> Face:
    """Return which of the faces looks up the most."""
    return max(faces, key=lambda face: float((X_world_box[:3, :3] @ face_normal(face))[2]))
