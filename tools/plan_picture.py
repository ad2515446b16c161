"""A plan as one picture: a column for the search area and for each grasp; above the boxes, below the hands."""

from __future__ import annotations

import numpy as np

from preshape.hal.transform import Matrix, cross
from preshape.hal.world import face_normal
from preshape.tools.caption import PAPER, captioned, grid, write
from preshape.tools.plan_drawing import (
    ALLOWED,
    SEARCHED,
    GraspDrawing,
    PlanDrawing,
    area_shapes,
    axes_shapes,
    box_shapes,
    component_shapes,
    hand_shapes,
    part_shapes,
    tip_shapes,
)
from preshape.tools.raster import Camera, Picture, look_at, render
from preshape.tools.shape import Shape

LEGEND = "palm patch blue, thumb patch red, finger patch green; preshaping box violet, its axes x red, y green, z blue"
_ANGLE = 0.5


def object_shapes(plan: PlanDrawing) -> list[Shape]:
    """Return all parts of the object."""
    return [shape for part in plan.parts for shape in part_shapes(part)]


def object_size(plan: PlanDrawing) -> float:
    """Return the radius of a ball around the object's origin that holds all its parts, m."""
    return max(float(np.linalg.norm(p.X_object_box[:3, 3]) + np.linalg.norm(p.half)) for p in plan.parts)


def viewing_direction(grasp: GraspDrawing) -> Matrix:
    """Return a unit direction from which the thumb's face and the side of the grasp are seen.

    The palm's face is seen, too, unless it points down.
    """
    thumb, palm = face_normal(grasp.box.thumb_face), face_normal(grasp.box.palm_face)
    third = np.abs(cross(thumb, palm))
    direction = 0.80 * thumb + 0.75 * third + 0.55 * palm
    direction[2] = max(direction[2], 0.35)
    return direction / np.linalg.norm(direction)


def camera_for(direction: Matrix, target: Matrix, radius: float) -> Camera:
    """Return a camera along a direction that just holds a ball of `radius` (m) around the target."""
    return look_at(target + direction * radius / np.sin(_ANGLE / 2), target, _ANGLE)


def search_panel(plan: PlanDrawing, width: int, height: int) -> Picture:
    """Return the object with its sections and the area that the camera searches."""
    shapes = object_shapes(plan) + area_shapes(plan.parts[0], plan.searched, SEARCHED) + axes_shapes(np.eye(4), 0.15)
    direction = np.array([0.70, 0.55, 0.45])
    camera = camera_for(direction / np.linalg.norm(direction), np.zeros(3), 1.15 * object_size(plan))
    return captioned(render(shapes, camera, width, height), ["object, sections, search area", "axes of the object"])


def grasp_panel(plan: PlanDrawing, grasp: GraspDrawing, width: int, height: int) -> Picture:
    """Return the grasping area, the component chosen, its preshaping box and the fingertip targets."""
    part, box = plan.parts[grasp.part], grasp.box
    shapes = object_shapes(plan) + area_shapes(part, grasp.area, ALLOWED) + component_shapes(part, grasp)
    shapes += box_shapes(box) + tip_shapes(grasp.tips)
    camera = camera_for(viewing_direction(grasp), np.zeros(3), 1.15 * object_size(plan))
    size = " x ".join(f"{2e3 * h:.0f}" for h in box.half)
    lines = [grasp.title, f"palm {box.palm_face}, thumb {box.thumb_face}, section {grasp.section}; box {size} mm"]
    return captioned(render(shapes, camera, width, height), lines)


def hand_panel(plan: PlanDrawing, grasp: GraspDrawing, width: int, height: int, lines: int) -> Picture:
    """Return the hand at its preshape beside the object, with `lines` of notes below."""
    shapes = object_shapes(plan) + component_shapes(plan.parts[grasp.part], grasp)
    hand = hand_shapes(grasp.side, grasp.X_object_palm, grasp.joints)
    corners = np.array([shape.X_world_shape[:3, 3] for shape in shapes + hand])
    middle = (corners.min(0) + corners.max(0)) / 2
    radius = float(np.linalg.norm(corners - middle, axis=1).max()) + 0.075
    picture = render(shapes + hand, camera_for(viewing_direction(grasp), middle, radius), width, height)
    return captioned(picture, [*grasp.notes, *[""] * lines][:lines])


def plan_picture(plan: PlanDrawing, width: int = 380, height: int = 320) -> Picture:
    """Return the picture of a plan; width and height are those of one panel, in pixels."""
    if not plan.parts:
        raise ValueError("a plan to be drawn needs at least one part")
    lines = max([2, *(len(grasp.notes) for grasp in plan.grasps)])
    upper = [search_panel(plan, width, height), *(grasp_panel(plan, grasp, width, height) for grasp in plan.grasps)]
    lower = [hand_panel(plan, grasp, width, height, lines) for grasp in plan.grasps]
    sheets = [grid(upper, len(upper))]
    if lower:
        blank = np.full_like(lower[0], PAPER)
        noted = write(blank, [*plan.notes, "", *_wrapped(LEGEND, 52)], 6, 8, 13)
        sheets.append(grid([noted, *lower], len(upper)))
    return np.vstack(sheets)


def _wrapped(text: str, length: int) -> list[str]:
    lines = [""]
    for word in text.split():
        if len(lines[-1]) + len(word) >= length:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines
