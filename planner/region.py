"""Exact algebra of regions on a box's surface: every region is a set of patches, kept as one integer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache

from preshape.hal.world import Face, end_caps, long_faces

Patch = tuple[int, Face]
"""One section of the surface: its number along the longest edge (0 at the negative end), and the face."""

SECTIONS = 3
PATCHES = 14
"""Four long faces in three sections, and two end caps."""

WHOLE = (1 << PATCHES) - 1
"""G_o of section III-B: the whole surface, as bits."""


@cache
def patches_of(long_axis: int) -> tuple[Patch, ...]:
    """Return all patches of a box's surface; a patch's place is its bit, the same for every long axis."""
    low, high = end_caps(long_axis)
    around: list[Patch] = [(section, face) for section in range(SECTIONS) for face in long_faces(long_axis)]
    return (*around, (0, low), (SECTIONS - 1, high))


@cache
def _bits(long_axis: int) -> dict[Patch, int]:
    return {patch: 1 << k for k, patch in enumerate(patches_of(long_axis))}


@cache
def bits_of(long_axis: int, patch: Patch) -> int:
    """Return the bit of a patch; `ValueError` if the surface has no such patch."""
    bit = _bits(long_axis).get(patch)
    if bit is None:
        raise ValueError(f"patch {patch}: a box along {'xyz'[long_axis]} has sections 0 .. 2, caps only at its ends")
    return bit


@cache
def _neighbours() -> tuple[int, ...]:
    """Return the patches that share an edge with each patch, as bits."""
    rows = [0] * PATCHES
    for section in range(SECTIONS):
        for k in range(4):
            # Of the four long faces only the opposite one (0-1, 2-3) shares no edge with a face.
            beside = [4 * section + other for other in range(4) if other not in (k, k ^ 1)]
            along = [4 * other + k for other in (section - 1, section + 1) if 0 <= other < SECTIONS]
            cap = {0: [PATCHES - 2], SECTIONS - 1: [PATCHES - 1]}.get(section, [])
            for other in (*beside, *along, *cap):
                rows[4 * section + k] |= 1 << other
                rows[other] |= 1 << (4 * section + k)
    return tuple(rows)


@dataclass(frozen=True, slots=True)
class Region:
    """A set of patches of a box whose longest edge runs along axis `long_axis`.

    Patches are open rectangles, so union, intersection and complement of regions are exactly those of the sets;
    the cuts between patches have no area and belong to no region.
    """

    long_axis: int
    mask: int

    def __post_init__(self) -> None:
        if not (0 <= self.long_axis <= 2 and 0 <= self.mask <= WHOLE):
            raise ValueError(f"region: axis {self.long_axis}, bits {self.mask:#x}; allowed: 0 .. 2, up to {WHOLE:#x}")

    @staticmethod
    def whole(long_axis: int) -> Region:
        """Return G_o, the whole surface."""
        return Region(long_axis, WHOLE)

    @staticmethod
    def of(long_axis: int, patches: Iterable[Patch]) -> Region:
        """Return the region of these patches."""
        mask = 0
        for patch in patches:
            mask |= bits_of(long_axis, patch)
        return Region(long_axis, mask)

    def _other(self, other: Region) -> int:
        if other.long_axis != self.long_axis:
            raise ValueError("regions of boxes with different longest edges cannot be combined")
        return other.mask

    def __or__(self, other: Region) -> Region:
        return Region(self.long_axis, self.mask | self._other(other))

    def __and__(self, other: Region) -> Region:
        return Region(self.long_axis, self.mask & self._other(other))

    def __sub__(self, other: Region) -> Region:
        return Region(self.long_axis, self.mask & ~self._other(other))

    def __invert__(self) -> Region:
        return Region(self.long_axis, WHOLE & ~self.mask)

    def __le__(self, other: Region) -> bool:
        return self.mask & ~self._other(other) == 0

    def __bool__(self) -> bool:
        return self.mask != 0

    def __len__(self) -> int:
        return self.mask.bit_count()

    def __contains__(self, patch: object) -> bool:
        return any(patch == own for own in self.patches)

    def __iter__(self) -> Iterator[Patch]:
        return (patch for k, patch in enumerate(patches_of(self.long_axis)) if self.mask >> k & 1)

    @property
    def patches(self) -> frozenset[Patch]:
        """The region as a set."""
        return frozenset(self)

    def parts(self) -> tuple[Region, ...]:
        """Return the region's connected parts: patches that share an edge belong together."""
        rows, left, found = _neighbours(), self.mask, list[Region]()
        while left:
            part, frontier = 0, left & -left
            while frontier:
                part |= frontier
                reached = 0
                for k in range(PATCHES):
                    if frontier >> k & 1:
                        reached |= rows[k]
                frontier = reached & left & ~part
            found.append(Region(self.long_axis, part))
            left &= ~part
        return tuple(found)
