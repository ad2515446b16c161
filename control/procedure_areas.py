"""The areas of the paper's procedure (section III-B), and the grips that lie in them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from preshape.control.failure import TaskFailed
from preshape.control.grip import Grip
from preshape.hal.layout import Side
from preshape.hal.transform import Matrix
from preshape.hal.world import FACES, Face, NominalBox, Opening, face_normal
from preshape.planner.areas import Areas, plan_areas
from preshape.planner.component import Component
from preshape.planner.procedure import HAND_OF, PAPER_PROCEDURE, SIDE_OF, Block


def palm_face(grip: Grip) -> Face:
    """Return the face that the palm's z axis looks against."""
    return _against(grip.X_box_palm[:3, 2])


def finger_face(grip: Grip) -> Face:
    """Return the face that the palm's x axis, from fingers to thumb, looks against."""
    return _against(grip.X_box_palm[:3, 0])


def _against(direction: Matrix) -> Face:
    return max(FACES, key=lambda face: float(-direction @ face_normal(face)))


def realizes(grip: Grip, component: Component) -> bool:
    """Return whether a grip has its palm and its fingers on a component's patches."""
    return component.palm == palm_face(grip) and finger_face(grip) in component.pair


def lies_in(grip: Grip, components: Iterable[Component]) -> bool:
    """Return whether a grip realizes one of some components."""
    return any(realizes(grip, component) for component in components)


def procedure_areas(box: NominalBox, opening: Opening | None, grips: Mapping[Side, Grip]) -> Areas:
    """Return all areas of the procedure; where a grip is given, its component counts as the one chosen."""

    def choose(block: Block, candidates: tuple[Component, ...]) -> Component:
        grip = None if block.resource == "c" else grips.get(SIDE_OF[block.resource])
        fitting = [] if grip is None else [c for c in candidates if realizes(grip, c)]
        return (fitting or list(candidates))[0]

    return plan_areas(PAPER_PROCEDURE, box, opening, choose=choose)


def components_left(
    box: NominalBox, opening: Opening | None, grips: Mapping[Side, Grip], side: Side, task: int
) -> tuple[Component, ...]:
    """Return the components that priorities and areas leave to a hand in a task (from 1), beside the grips taken.

    Raises:
        TaskFailed: nothing is left, with the certificate that says why.
    """
    areas = procedure_areas(box, opening, grips)
    area = areas.at(HAND_OF[side], task)
    if areas.certificate is not None or area is None or not area.candidates:
        raise TaskFailed(f"unreachable: no area for the {side} hand in task {task}: {areas.certificate}")
    return area.candidates
