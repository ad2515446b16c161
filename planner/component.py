"""Components of a grasping area: a palm patch and an unordered pair of opposite grasp patches (section III-B)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

from numpy.typing import ArrayLike

from preshape.hal.world import Face, end_caps, long_faces, opposite
from preshape.planner.preshaping_box import FINGER_REACH, MARGIN, PreshapingBox, box_from_component
from preshape.planner.region import SECTIONS, Patch, Region, bits_of


@dataclass(frozen=True, slots=True)
class Component:
    """Three patches of one section: `palm`, and the two opposite faces of `pair`, the one in + direction first."""

    section: int
    palm: Face
    pair: tuple[Face, Face]

    def __post_init__(self) -> None:
        first, second = self.pair
        if not 0 <= self.section < SECTIONS:
            raise ValueError(f"component: section must be 0 .. {SECTIONS - 1}, got {self.section}")
        if first[0] != "+" or second != opposite(first):
            raise ValueError(f"component: pair must be two opposite faces, + first, got {first} and {second}")
        if self.palm in self.pair:
            raise ValueError(f"component: the palm's face {self.palm} is one of the grasped faces")

    def __str__(self) -> str:
        return f"section {self.section}, palm {self.palm}, grasp {self.pair[0]} {self.pair[1]}"

    @property
    def patches(self) -> frozenset[Patch]:
        """The three patches that must survive in an area."""
        return frozenset((self.section, face) for face in (self.palm, *self.pair))

    def preshaping_boxes(
        self, lower: ArrayLike, upper: ArrayLike, margin: float = MARGIN, reach: float = FINGER_REACH
    ) -> tuple[PreshapingBox, PreshapingBox]:
        """Return both choices of section III-C, thumb on either face of the pair.

        `lower` and `upper` (3,) m are the section's corners; see `box_from_component` for the rest.
        """
        thumb, other = self.pair
        return (
            box_from_component(self.palm, thumb, lower, upper, margin, reach),
            box_from_component(self.palm, other, lower, upper, margin, reach),
        )


@cache
def all_components(long_axis: int) -> tuple[Component, ...]:
    """Return every component of a box: 6 in each end section (3 palms x 2 pairs), 4 in the middle one.

    Those with the palm on an end cap come first.
    """
    a, b, c, d = long_faces(long_axis)
    one: tuple[Face, Face] = (a, b)
    two: tuple[Face, Face] = (c, d)
    pairs = ((one, two), (two, one))
    ends = zip((0, SECTIONS - 1), end_caps(long_axis), strict=True)
    on_caps = [Component(section, cap, pair) for section, cap in ends for pair, _ in pairs]
    around = [Component(s, palm, pair) for s in range(SECTIONS) for pair, beside in pairs for palm in beside]
    return (*on_caps, *around)


@cache
def component_masks() -> tuple[int, ...]:
    """Return each component's three patches as bits; the same for every long axis."""
    return tuple(sum(bits_of(2, patch) for patch in component.patches) for component in all_components(2))


@cache
def on_end_caps() -> int:
    """Return which components have the palm on an end cap; bit k is component k."""
    return sum(1 << k for k, component in enumerate(all_components(2)) if component.palm in end_caps(2))


@cache
def surviving(region_mask: int) -> int:
    """Return which components have all three patches in a region; bit k is component k."""
    return sum(1 << k for k, mask in enumerate(component_masks()) if mask & ~region_mask == 0)


EVERY = (1 << len(component_masks())) - 1
"""All components, as bits."""


@lru_cache(maxsize=4096)
def numbered(long_axis: int, chosen: int) -> tuple[tuple[int, Component], ...]:
    """Return the components whose bits are set, each with its bit."""
    return tuple((1 << k, component) for k, component in enumerate(all_components(long_axis)) if chosen >> k & 1)


def selected(long_axis: int, chosen: int) -> tuple[Component, ...]:
    """Return the components whose bits are set."""
    return tuple([component for _, component in numbered(long_axis, chosen)])


def components_in(region: Region, palm_on_end_caps_only: bool = False) -> tuple[Component, ...]:
    """Return the components of an area: those whose three patches all lie in its region."""
    chosen = surviving(region.mask) & (on_end_caps() if palm_on_end_caps_only else EVERY)
    return selected(region.long_axis, chosen)
