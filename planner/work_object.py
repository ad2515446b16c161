"""What is grasped: one box, or an object split into convex parts, each stood for by its smallest box (III-A)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from preshape.hal.transform import Matrix
from preshape.hal.world import NominalBox, OrientedBox
from preshape.planner.parts import Part, minimum_box


@dataclass(frozen=True, slots=True, eq=False)
class WorkPart:
    """One part: its box, the box's pose in the object's frame, and the corners (n, 3) of its true hull, if known."""

    name: str
    box: NominalBox
    X_object_part: Matrix = field(default_factory=lambda: np.eye(4))
    vertices: Matrix | None = None

    @property
    def half(self) -> Matrix:
        """Half edges of the part's box (3,), m."""
        return np.asarray(self.box.size, float) / 2.0


@dataclass(frozen=True, slots=True, eq=False)
class WorkObject:
    """An object as its parts."""

    parts: tuple[WorkPart, ...]

    def __post_init__(self) -> None:
        if not self.parts:
            raise ValueError("object: parts is empty, at least one is needed")

    def boxes(self, X_world_object: Matrix, but: WorkPart | None = None) -> tuple[OrientedBox, ...]:
        """Return the parts' boxes in the world, one of them left out if asked."""
        return tuple(
            OrientedBox(part.name, X_world_object @ part.X_object_part, part.half)
            for part in self.parts
            if part is not but
        )


def box_object(box: NominalBox) -> WorkObject:
    """Return a box as an object of one part, in the same frame."""
    return WorkObject((WorkPart("box", box),))


def object_of_parts(parts: Iterable[Part]) -> WorkObject:
    """Return an object without an opening from its convex parts."""
    found: list[WorkPart] = []
    for part in parts:
        around = minimum_box(part)
        box = NominalBox(2.0 * around.half, ())
        found.append(WorkPart(part.name, box, around.X_object_box, part.vertices))
    return WorkObject(tuple(found))
