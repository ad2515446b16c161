"""How far tab and lid stand open, for pictures: by what the thumb that moves them has done. Nobody measures it."""

from __future__ import annotations

import numpy as np

from preshape.control.opening_frame import hinge_distance, opening_frame
from preshape.hal.layout import LAYOUT
from preshape.hal.sah_hand import TIP_RADIUS
from preshape.hal.tick_record import TickRecord
from preshape.hal.transform import Matrix, axis_rotation, inverse, transform
from preshape.hal.world import FACES, NominalBox, Opening
from preshape.planner.arm_kinematics import palm_pose
from preshape.planner.hand_kinematics import hand_kinematics

LIFTING = (b"lever", b"tear", b"raise", b"hook", b"pinch", b"turn")
"""Phases of task 5 in which the lid lies on the thumb."""
Y = np.array([0.0, 1.0, 0.0])


class LidEstimate:
    """Angles of tab (inwards) and lid (outwards), rad: the farthest that the thumb's tip has been about their hinges.

    With the tip at (x, z) of the opening's frame, h and d the distances of the hinges of lid and tab from its origin:
    lid atan2(z + r, x + h) while the lid lies on the thumb, tab atan2(r - z, x + d) once the thumb comes down on it.
    """

    def __init__(self, X_world_base: Matrix, box: NominalBox, opening: Opening) -> None:
        """Begin closed; `X_world_base` is the right arm's."""
        self._X_world_base = X_world_base
        self._X_box_opening = opening_frame(box, opening)
        self._lid_m = hinge_distance(box, opening)
        self._tab_m = float(box.tab_size[1] / 2)
        self.tab = self.lid = 0.0

    @classmethod
    def of_record(cls, X_world_base: Matrix, box: NominalBox, record: TickRecord) -> LidEstimate:
        """Begin closed, with the opening that a record names."""
        face, edge = FACES[int(record["opening_face"])], FACES[int(record["opening_edge"])]
        return cls(X_world_base, box, Opening(face=face, edge=edge, offset=float(record["opening_offset"])))

    def update(self, record: TickRecord) -> bool:
        """Take one record; return whether something has moved."""
        if record["task"] < 4 or np.isnan(record["position"][0]) or np.isnan(record["X_world_object"][0, 0]):
            return False
        x, _, z = self._tip(record)
        lid, tab = 0.0, 0.0
        if record["task"] == 5 and bytes(record["phase"].item()) in LIFTING:
            lid = float(np.arctan2(z + TIP_RADIUS, x + self._lid_m))
        elif abs(x) < self._tab_m and z < TIP_RADIUS:
            tab = float(np.arctan2(TIP_RADIUS - z, x + self._tab_m))
        before = self.tab, self.lid
        self.tab, self.lid = max(self.tab, min(tab, np.pi / 2)), max(self.lid, min(lid, np.pi))
        return before != (self.tab, self.lid)

    @property
    def X_box_lid(self) -> Matrix:
        """What the lid's angle does to points of the closed lid, in the object's frame."""
        return self._turned(-self._lid_m, -self.lid)

    @property
    def X_box_tab(self) -> Matrix:
        """The same for the tab, which goes with the lid."""
        return self.X_box_lid @ self._turned(-self._tab_m, self.tab)

    def _turned(self, hinge_x: float, angle: float) -> Matrix:
        X_box_hinge = self._X_box_opening @ transform((hinge_x, 0.0, 0.0))
        return X_box_hinge @ transform(R=axis_rotation(Y, angle)) @ inverse(X_box_hinge)

    def _tip(self, record: TickRecord) -> Matrix:
        """Return the right thumb's tip (3,) in the opening's frame, m."""
        q = record["position"]
        X_world_palm = palm_pose("right", self._X_world_base, q[LAYOUT.arm("right")])
        tip = hand_kinematics("right").tips(q[LAYOUT.hand("right")])[0][0]
        X_opening_palm = inverse(record["X_world_object"] @ self._X_box_opening) @ X_world_palm
        return X_opening_palm[:3, :3] @ tip + X_opening_palm[:3, 3]
