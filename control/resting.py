"""What the table tells of an object that rests on it: height and tilt, better than the eye."""

from __future__ import annotations

import numpy as np

from preshape.hal.transform import Matrix, cross, exp_so3, transform
from preshape.hal.world import FACES, face_normal
from preshape.planner.air_pose import upper_face


def rested(X_world_object: Matrix, size: Matrix, table_height: float = 0.0) -> Matrix:
    """Return the pose nearest to an estimate in which an object of outer size (3,), m, rests flat on the table.

    The face that looks up the most is turned by the least angle until it looks straight up.
    """
    up = face_normal(upper_face(X_world_object, FACES))
    above = X_world_object[:3, :3] @ up
    axis = cross(above, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    turn = axis / sine * np.arctan2(sine, above[2]) if sine > 1e-12 else np.zeros(3)
    height = table_height + float(np.abs(up) @ np.asarray(size, float)) / 2
    return transform((X_world_object[0, 3], X_world_object[1, 3], height), exp_so3(turn) @ X_world_object[:3, :3])
