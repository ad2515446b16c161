"""Whether a task can be done at all, before anything moves: what no hand spans and no arm reaches is named."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from preshape.control.grip import Grip
from preshape.control.grips import CAP_Z, brace_grip, cage_grip
from preshape.hal import sah_hand
from preshape.hal.layout import Side
from preshape.hal.transform import Matrix, cross, transform
from preshape.hal.world import FACES, Face, NominalBox, Workcell, end_caps, face_normal
from preshape.planner.air_pose import AirPlace
from preshape.planner.arm_reach import ReachStatus, reach
from preshape.planner.span import widest_gap

SURELY_SPANNED_M = 0.10
"""Narrower than any hand's span: the span need not be computed, m."""
SECTIONS = (-1 / 3, 0.0, 1 / 3)
"""Middles of the three sections along the longest edge, as shares of it."""


def impossibility(cell: Workcell, box: NominalBox, X_world_box: Matrix) -> tuple[int, str] | None:
    """Return the task that nobody could do with a box at a pose, and why; None if nothing is known against it.

    Only what is necessary is checked: two opposite faces that a hand spans, a face that the right palm reaches,
    and, for a box that may open, a grip of each hand that suits its widths, and that both arms reach its two ends
    where it is handed over.
    """
    if cause := _span_cause(box) or _reach_cause(cell, box, X_world_box):
        return 1, cause
    if not box.candidate_faces:
        return None
    _, end = end_caps(box.long_axis)
    if cause := _grip_cause("fingers", box.closed_sides, lambda face: cage_grip(box.size, end, face, "right")):
        return 1, cause
    if cause := _grip_cause("opening", box.candidate_faces, lambda face: brace_grip(box.size, end, face, "left")):
        return 3, cause
    if cause := _handover_cause(cell, box):
        return 3, cause
    return None


def _grip_cause(what: str, faces: Sequence[Face], grip: Callable[[Face], Grip]) -> str:
    """Return why no grip suits the box whichever face it goes by, empty if one does."""
    causes: list[str] = []
    for face in faces:
        try:
            grip(face)
        except ValueError as error:
            causes.append(f"{what} on {face}: {error}")
        else:
            return ""
    return f"no span: {'; '.join(causes) or f'no face is left for the {what}'}"


def _span_cause(box: NominalBox) -> str:
    width = float(np.min(box.size))
    if width <= SURELY_SPANNED_M:
        return ""
    widest = widest_gap(sah_hand.FINGERS[:2])
    if width <= widest:
        return ""
    return f"no span: the box is {width:g} m across at its narrowest, a hand spans {widest:.3f} m"


def _reach_cause(cell: Workcell, box: NominalBox, X_world_box: Matrix) -> str:
    if any(_reaches(cell, "right", X) for X in palms_around(box, X_world_box)):
        return ""
    place = ", ".join(f"{value:.2f}" for value in X_world_box[:3, 3])
    return f"unreachable: the right hand reaches no face of the box at ({place}) m"


def _handover_cause(cell: Workcell, box: NominalBox) -> str:
    place = AirPlace()
    half = float(np.max(box.size)) / 2
    sides: tuple[tuple[Side, float], ...] = (("right", 1.0), ("left", -1.0))
    for side, sign in sides:
        outward = sign * place.toward_right
        if not any(_reaches(cell, side, X) for X in _facing(place.center + half * outward, outward)):
            center = ", ".join(f"{value:.2f}" for value in place.center)
            return f"unreachable: the {side} hand reaches no end of the box where it is handed over, ({center}) m"
    return ""


def palms_around(box: NominalBox, X_world_box: Matrix) -> Iterator[Matrix]:
    """Yield palm poses before every section and end cap of a box, leaving out the face that looks down."""
    axis = np.eye(3)[box.long_axis]
    faces = sorted(FACES, key=lambda face: -float((X_world_box[:3, :3] @ face_normal(face))[2]))
    for face in faces[:-1]:
        n = face_normal(face)
        sections = (0.0,) if abs(n @ axis) > 0.5 else SECTIONS
        for share in sections:
            p_box = n * (np.abs(n) @ box.size) / 2 + share * box.size[box.long_axis] * axis
            p_world = X_world_box[:3, :3] @ p_box + X_world_box[:3, 3]
            yield from _facing(p_world, X_world_box[:3, :3] @ n)


def _facing(p_face: Matrix, normal: Matrix) -> Iterator[Matrix]:
    """Yield palm poses before a point, looking against a normal, turned about it by quarters."""
    across = cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    for x in (across, cross(normal, across), -across, -cross(normal, across)):
        yield transform(p_face + CAP_Z * normal, np.column_stack([x, cross(-normal, x), -normal]))


def _reaches(cell: Workcell, side: Side, X_world_palm: Matrix) -> bool:
    return reach(side, cell.X_world_base[side], X_world_palm).status is ReachStatus.REACHABLE
