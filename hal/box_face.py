"""The frame of one face of a box: what textures are printed in and images are rectified to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.transform import Matrix, cross, transform
from preshape.hal.world import Face, face_normal


@dataclass(frozen=True, slots=True, eq=False)
class FaceFrame:
    """X_box_face: origin at the face's centre, x (u) along its longer edge, z outward, y (v) = z cross x.

    `half` holds the half edges along u and v, m. Seen from outside with u to the right, v points up.
    """

    X_box_face: Matrix
    half: Matrix

    def edge_sign(self, edge: Face) -> int:
        """Return +1 or -1: the sign of v on the long edge towards the face `edge`; 0 if it is no such edge."""
        return int(np.rint(self.X_box_face[:3, 1] @ face_normal(edge)))


def face_frame(size: ArrayLike, face: Face) -> FaceFrame:
    """Return the frame of a face of a box of outer `size` (3,), m, centred at the box's origin."""
    half = np.asarray(size, float) / 2
    normal = face_normal(face)
    u = np.eye(3)[int(np.argmax(np.where(np.abs(normal) > 0, -1.0, half)))]
    v = cross(normal, u)
    R_box_face = np.column_stack([u, v, normal])
    return FaceFrame(transform(normal * (np.abs(normal) @ half), R_box_face), np.array([u @ half, np.abs(v) @ half]))
