"""What a plan is made for: the workcell, the object and where it is, what is known of its opening, who holds it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from preshape.hal.layout import SIDES, Side
from preshape.hal.transform import Matrix, inverse, transform
from preshape.hal.world import Face, Opening, OrientedBox, Workcell, end_caps, long_faces, opposite
from preshape.planner.air_pose import AirPlace, air_pose
from preshape.planner.component import Component
from preshape.planner.postures import PRESHAPE
from preshape.planner.procedure import Hand, Place
from preshape.planner.work_object import WorkObject, WorkPart

LIFT_M = 0.13
"""How far an object is lifted, m."""

ARMS_AT_REST = np.array([-1.372, -0.859, 1.185, -2.359, 0.814, 1.836, -0.890])
"""Where the right arm waits, rad: its palm above the table, pointing down; the left arm is its mirror image."""

_MIRRORED = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


def arms_at_rest() -> Matrix:
    """Return q (14), right then left arm, rad."""
    return np.concatenate([ARMS_AT_REST, _MIRRORED * ARMS_AT_REST])


Poses = Iterable[Matrix]
"""Poses of the object in the world of which any will do."""


def _preshape_hands() -> dict[Side, Matrix]:
    return {side: PRESHAPE for side in SIDES}


@dataclass(frozen=True, slots=True)
class Held:
    """A hand that holds the object already: nothing but this grasp is left to it."""

    hand: Hand
    component: Component
    thumb_face: Face


def held_by_cap(hand: Hand, end: Face, finger_face: Face) -> Held:
    """Return the hold of a hand whose palm is before an end cap and whose fingers are on a face beside it."""
    positive, negative = (finger_face, opposite(finger_face))[:: 1 if finger_face[0] == "+" else -1]
    component = Component(2 if end[0] == "+" else 0, end, (positive, negative))
    return Held(hand, component, opposite(finger_face))


@dataclass(frozen=True, slots=True, eq=False)
class PlanScene:
    """The scene of a plan.

    Attributes:
        cell: arms, static bodies, camera.
        target: the object.
        X_world_object: where it is now.
        opening: None while it is unknown.
        likely: the candidate face that is thought to carry the opening, None when all count alike.
        held: who holds the object already, and how; None while it rests.
        obstacles: bodies in the way besides the cell's.
        q_arms: where both arms are (14), rad.
        q_hands: finger joints (13) of x_n in eq. (5), rad.
        place: where the object is shown and handed over.
        open_places: where the other hand may open it; the first within reach will do.
    """

    cell: Workcell
    target: WorkObject
    X_world_object: Matrix
    opening: Opening | None = None
    likely: Face | None = None
    held: Held | None = None
    obstacles: tuple[OrientedBox, ...] = ()
    q_arms: Matrix = field(default_factory=arms_at_rest)
    q_hands: Mapping[Side, Matrix] = field(default_factory=_preshape_hands)
    place: AirPlace = field(default_factory=AirPlace)
    open_places: tuple[AirPlace, ...] = field(default_factory=lambda: (AirPlace(),))

    @property
    def bodies(self) -> tuple[OrientedBox, ...]:
        """All bodies but the robot and the object."""
        return (*self.cell.statics, *self.obstacles)

    def faces(self, part: WorkPart) -> tuple[Face, ...]:
        """Return the faces that may carry the opening, or the one that (most likely) does."""
        known = self.likely if self.opening is None else self.opening.face
        return part.box.candidate_faces if known is None else (known,)

    def object_poses(self, part: WorkPart, hand: Hand, component: Component, place: Place) -> dict[Face | None, Poses]:
        """Return where a grasp must hold the object in a task: for each face that may carry the opening, one of some.

        The key is None where the opening does not matter.
        """
        X = self.X_world_object
        if place == "here" or (place == "handed over" and self.held is not None):
            return {None: (X,)}
        if place == "lifted":
            return {None: (transform((0.0, 0.0, LIFT_M)) @ X,)}
        if place == "passed on":
            ends = _right_ends(part, hand, component)
            return {None: _air_poses(part, (self.place,), ends, long_faces(part.box.long_axis))}
        places = self.open_places if place == "opened" else (self.place,)
        ends = _right_ends(part, hand, component)
        return {face: _air_poses(part, places, ends, (face,)) for face in self.faces(part)}


def _air_poses(part: WorkPart, places: tuple[AirPlace, ...], ends: tuple[Face, ...], faces: tuple[Face, ...]) -> Poses:
    """Yield poses one by one: mostly the first will do."""
    X_part_object = inverse(part.X_object_part)
    for place, end, face in product(places, ends, faces):
        yield air_pose(place, end, face) @ X_part_object


def _right_ends(part: WorkPart, hand: Hand, component: Component) -> tuple[Face, ...]:
    """Return which end caps may look to the robot's right: a hand has its own end of the box on its own side."""
    low, high = end_caps(part.box.long_axis)
    if component.section == 1:
        return low, high
    own = low if component.section == 0 else high
    return (own,) if hand == "r" else (opposite(own),)
