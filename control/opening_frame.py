"""The frame of an opening: origin at the tab's centre on the outer face, x to the tab's edge, z outward."""

from __future__ import annotations

import numpy as np

from preshape.hal.transform import Matrix, cross, transform
from preshape.hal.world import NominalBox, Opening, face_normal


def opening_frame(box: NominalBox, opening: Opening) -> Matrix:
    """Return X_box_opening: x away from the hinge, z the face's outward normal, y = z x x along the long axis."""
    half = box.size / 2
    normal, edge = face_normal(opening.face), face_normal(opening.edge)
    along = np.eye(3)[box.long_axis]
    origin = (
        normal * (np.abs(normal) @ half) + edge * (np.abs(edge) @ half - box.tab_size[1] / 2) + along * opening.offset
    )
    return transform(origin, np.column_stack([edge, cross(normal, edge), normal]))


def hinge_distance(box: NominalBox, opening: Opening) -> float:
    """Return the distance of the lid's hinge from the opening frame's origin, towards -x, m."""
    return float(np.abs(face_normal(opening.edge)) @ box.size) - float(box.tab_size[1]) / 2
