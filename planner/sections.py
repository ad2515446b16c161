"""The split of a box along its longest edge (Fig. 5): two end sections and a middle one that holds the opening."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from preshape.hal import sah_hand
from preshape.hal.transform import Matrix
from preshape.hal.world import Face, NominalBox, Opening, face_normal, long_faces
from preshape.planner.region import SECTIONS, Patch, Region, bits_of

FINGER_WIDTH = 2.0 * sah_hand.PARTS["thumb_mid"][0].size[0]
"""Width of a thumb, m: so much wider than the opening is the middle section."""


@dataclass(frozen=True, slots=True)
class Sections:
    """A box of outer `size` (m), centred at its frame, cut by two planes across its longest edge.

    `cuts` are the planes' coordinates along the longest edge, m. `candidate_faces` may carry the opening.
    """

    size: tuple[float, float, float]
    cuts: tuple[float, float]
    candidate_faces: tuple[Face, ...]

    @property
    def long_axis(self) -> int:
        """Index of the longest edge's direction."""
        return self.size.index(max(self.size))

    @property
    def stations(self) -> tuple[float, float, float, float]:
        """Where sections begin and end along the longest edge, m."""
        half = self.size[self.long_axis] / 2.0
        return -half, *self.cuts, half

    def corners(self, section: int) -> tuple[Matrix, Matrix]:
        """Return the lower and the upper corner (3,) of a section in the box's frame, m."""
        if not 0 <= section < SECTIONS:
            raise ValueError(f"section must be 0 .. {SECTIONS - 1}, got {section}")
        upper = np.array(self.size) / 2.0
        lower = -upper
        lower[self.long_axis], upper[self.long_axis] = self.stations[section : section + 2]
        return lower, upper

    def rectangle(self, patch: Patch) -> tuple[Matrix, Matrix]:
        """Return the lower and the upper corner (3,) of a patch in the box's frame, m; equal along its normal."""
        bits_of(self.long_axis, patch)
        lower, upper = self.corners(patch[0])
        normal = face_normal(patch[1])
        lower, upper = np.where(normal > 0, upper, lower), np.where(normal < 0, lower, upper)
        return lower, upper

    def middle(self) -> Region:
        """Return the whole middle section, the search area of Fig. 5."""
        return _across(self.long_axis, (1,), long_faces(self.long_axis))

    def candidates(self) -> Region:
        """Return the middle patches of the faces that may carry the opening."""
        return _across(self.long_axis, (1,), self.candidate_faces)

    def opening(self, opening: Opening | None) -> Region:
        """Return the patch with the opening; while it is unknown, all patches that may have it."""
        return self.candidates() if opening is None else _across(self.long_axis, (1,), (opening.face,))

    def opened_faces(self, opening: Opening | None) -> Region:
        """Return all of the opening's face: there the lid swings, and from there the opening hand comes."""
        faces = self.candidate_faces if opening is None else (opening.face,)
        return _across(self.long_axis, tuple(range(SECTIONS)), faces)


@cache
def _across(long_axis: int, sections: tuple[int, ...], faces: tuple[Face, ...]) -> Region:
    """Return the patches of some sections on some faces."""
    return Region.of(long_axis, ((section, face) for section in sections for face in faces))


def split(box: NominalBox, opening: Opening | None = None, finger_width: float = FINGER_WIDTH) -> Sections:
    """Return the sections of a box.

    The middle one is a third of the longest edge while no opening is known; then it is as long as the tab and a
    finger's width, centred on the opening.

    Raises:
        ValueError: a size that is not 3 positive lengths; a candidate face or opening that is not on a face along
            the longest edge; an opening so near an end that no end section is left.
    """
    size = tuple(float(edge) for edge in box.size)
    if len(size) != 3 or not all(0.0 < edge < np.inf for edge in size):
        raise ValueError(f"box size: 3 positive lengths are needed, got {size} m")
    long_axis = box.long_axis
    allowed = long_faces(long_axis)
    for face in box.candidate_faces:
        _check_face("candidate_faces", face, allowed)
    if opening is None:
        middle = (-size[long_axis] / 6.0, size[long_axis] / 6.0)
    else:
        _check_opening(opening, box.candidate_faces, allowed)
        width = box.tab_size[0] + finger_width
        middle = (opening.offset - width / 2.0, opening.offset + width / 2.0)
    if not -size[long_axis] / 2.0 < middle[0] < middle[1] < size[long_axis] / 2.0:
        raise ValueError(
            f"opening.offset: the middle section from {middle[0]:.4f} to {middle[1]:.4f} m leaves no end section "
            f"of a box {size[long_axis]:.4f} m long"
        )
    return Sections(size, middle, box.candidate_faces)


def _check_face(field: str, face: Face, allowed: tuple[Face, ...]) -> None:
    if face not in allowed:
        raise ValueError(f"{field}: got {face}, allowed are faces along the longest edge: {', '.join(allowed)}")


def _check_opening(opening: Opening, candidates: tuple[Face, ...], allowed: tuple[Face, ...]) -> None:
    _check_face("opening.face", opening.face, allowed)
    if opening.face not in candidates:
        raise ValueError(f"opening.face: got {opening.face}, the candidate faces are {', '.join(candidates)}")
    _check_face("opening.edge", opening.edge, allowed)
    if opening.edge[1] == opening.face[1]:
        raise ValueError(f"opening.edge: {opening.edge} is no face beside {opening.face}")
