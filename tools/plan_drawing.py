"""What a plan looks like in three dimensions: sections, patches, preshaping boxes, fingertips and hands as shapes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal import sah_hand
from preshape.hal.description import part_box
from preshape.hal.layout import Side
from preshape.hal.transform import Matrix, transform
from preshape.hal.world import Face, face_normal
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.planner.preshaping_box import PreshapingBox
from preshape.tools.shape import Color, Shape, convex_body, segment, wire_box

Patch = tuple[int, Face]
"""One section of the surface: its number along the long axis, and the face."""

PAPER: Color = (0.87, 0.77, 0.58)
SEARCHED: Color = (0.98, 0.84, 0.30)
ALLOWED: Color = (0.80, 0.88, 0.80)
PALM: Color = (0.36, 0.52, 0.78)
THUMB: Color = (0.86, 0.42, 0.32)
FINGERS: Color = (0.36, 0.66, 0.48)
FRAME: Color = (0.45, 0.20, 0.62)
AXES: tuple[Color, Color, Color] = ((0.85, 0.15, 0.15), (0.10, 0.60, 0.20), (0.15, 0.30, 0.85))
SHEET = 0.0004
"""Thickness of a patch as drawn, m."""
LINE = 0.0007
"""Radius of a line as drawn, m."""


@dataclass(frozen=True, slots=True, eq=False)
class PartDrawing:
    """One part of the object: its minimum box (pose in the object's frame, half edges, m) and its sections.

    `cuts` are the planes between sections along the box's longest edge, as coordinates in its frame, m.
    `vertices` (n, 3), in the object's frame, draw the part's true hull inside the box.
    """

    half: Matrix
    X_object_box: Matrix = field(default_factory=lambda: np.eye(4))
    cuts: tuple[float, ...] = ()
    vertices: Matrix | None = None

    @property
    def long_axis(self) -> int:
        """Index of the longest edge's direction."""
        return int(np.argmax(self.half))

    def section(self, number: int) -> tuple[Matrix, Matrix]:
        """Return the lower and the upper corner of a section in the box's frame, m."""
        half = np.asarray(self.half, float)
        stations = (-half[self.long_axis], *self.cuts, half[self.long_axis])
        if not 0 <= number < len(stations) - 1:
            raise ValueError(f"section {number} is none of 0 .. {len(stations) - 2}")
        lower, upper = -half, half.copy()
        lower[self.long_axis], upper[self.long_axis] = stations[number], stations[number + 1]
        return lower, upper


@dataclass(frozen=True, slots=True, eq=False)
class GraspDrawing:
    """One grasp of the plan: the component chosen, its preshaping box, and the hand that goes with it.

    `box.X_object_pb`, `tips` (n, 3) m and `X_object_palm` are in the object's frame; `joints` are the hand's
    13 angles, rad; `area` holds all patches the hand may use; `notes` are lines printed below the picture.
    """

    title: str
    side: Side
    part: int
    section: int
    box: PreshapingBox
    tips: Matrix
    X_object_palm: Matrix
    joints: Matrix
    area: frozenset[Patch] = frozenset()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class PlanDrawing:
    """A whole plan: the object's parts, where the camera searches, the grasps in the order of use."""

    parts: tuple[PartDrawing, ...]
    grasps: tuple[GraspDrawing, ...]
    searched: frozenset[Patch] = frozenset()
    notes: tuple[str, ...] = ()


def patch_shape(part: PartDrawing, patch: Patch, color: Color, layer: int = 1) -> Shape:
    """Return a patch as a thin sheet on its face; a higher layer covers a lower one."""
    number, face = patch
    lower, upper = part.section(number)
    normal = face_normal(face)
    thick = np.abs(normal)
    surface = np.where(normal > 0, upper, lower)
    center = (lower + upper) / 2 * (1 - thick) + thick * surface + normal * layer * SHEET / 2
    half = (upper - lower) / 2 * (1 - thick) + thick * layer * SHEET / 2
    return Shape("box", part.X_object_box @ transform(center), half, color)


def part_shapes(part: PartDrawing) -> list[Shape]:
    """Return a part: its hull inside the edges of its minimum box, or the box itself, and the cuts around it."""
    half = np.asarray(part.half, float)
    if part.vertices is None:
        shapes = [Shape("box", part.X_object_box, half, PAPER)]
    else:
        shapes = [
            convex_body(part.vertices, np.eye(4), PAPER),
            *wire_box(part.X_object_box, half, LINE, (0.5, 0.4, 0.3)),
        ]
    for cut in part.cuts:
        around = half + SHEET
        around[part.long_axis] = 0.0
        center = np.zeros(3)
        center[part.long_axis] = cut
        shapes += wire_box(part.X_object_box @ transform(center), around, LINE, (0.35, 0.28, 0.20))
    return shapes


def area_shapes(part: PartDrawing, area: Iterable[Patch], color: Color) -> list[Shape]:
    """Return the patches of an area."""
    return [patch_shape(part, patch, color) for patch in sorted(area)]


def component_shapes(part: PartDrawing, grasp: GraspDrawing) -> list[Shape]:
    """Return the component's three patches: palm, thumb and fingers."""
    box = grasp.box
    faces: list[tuple[Face, Color]] = [(box.palm_face, PALM), (box.thumb_face, THUMB), (box.finger_face, FINGERS)]
    return [patch_shape(part, (grasp.section, face), color, layer=2) for face, color in faces]


def axes_shapes(X: Matrix, length: float) -> list[Shape]:
    """Return a frame's three axes: x red, y green, z blue."""
    origin = X[:3, 3]
    return [segment(origin, origin + length * X[:3, k], 2 * LINE, AXES[k]) for k in range(3)]


def box_shapes(box: PreshapingBox) -> list[Shape]:
    """Return a preshaping box: its edges, and its axes from its centre to beyond its faces."""
    return [
        *wire_box(box.X_object_pb, box.half, 1.5 * LINE, FRAME),
        *axes_shapes(box.X_object_pb, 1.35 * max(box.half)),
    ]


def tip_shapes(tips: ArrayLike) -> list[Shape]:
    """Return the fingertip targets (n, 3) as balls: the thumb's, which is the first, in the thumb's colour."""
    radius = np.full(3, 0.006)
    colors = (THUMB, FINGERS, FINGERS, FINGERS)
    return [Shape("ellipsoid", transform(p), radius, color) for p, color in zip(np.asarray(tips), colors, strict=False)]


def hand_shapes(side: Side, X_object_palm: Matrix, joints: ArrayLike) -> list[Shape]:
    """Return the 18 parts of a hand at a palm pose and 13 joint angles, rad."""
    shapes: list[Shape] = []
    turned = transform(R=np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
    for part, X in zip(sah_hand.PARTS, hand_kinematics(side).part_poses(joints), strict=True):
        center, half = part_box(side, part)
        X_object_part = X_object_palm @ X @ transform(center)
        color = THUMB if part.startswith("thumb") else PALM if part == "palm" else FINGERS
        shape = sah_hand.PARTS[part][0]
        if shape.kind == "box":
            shapes.append(Shape("box", X_object_part, half, color))
        else:
            radius, start, end = shape.size
            shapes.append(Shape("capsule", X_object_part @ turned, np.array([radius, (end - start) / 2, 0.0]), color))
    return shapes
