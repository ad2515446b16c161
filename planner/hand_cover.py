"""What a hand on the box keeps from the other one: its three patches, and those below the palm's overhang."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

from preshape.hal import sah_hand
from preshape.hal.world import end_caps
from preshape.planner.component import all_components, component_masks
from preshape.planner.region import SECTIONS, bits_of
from preshape.planner.sections import Sections

PALM_WIDTH = 2.0 * sah_hand.PARTS["palm"][0].size[1]
"""Width of the palm across its fingers, m: along the longest edge when the palm is on a long face."""


@dataclass(frozen=True, slots=True)
class Covers:
    """Per component, as bits: patches `used`, patches `covered` (used and overhung), `compatible` components.

    Two components are compatible when neither uses a patch that the other covers.
    """

    used: tuple[int, ...]
    covered: tuple[int, ...]
    compatible: tuple[int, ...]

    def supported(self, domain: int) -> int:
        """Return the components that are compatible with at least one of a domain."""
        found = 0
        while domain:
            found |= self.compatible[(domain & -domain).bit_length() - 1]
            domain &= domain - 1
        return found


@lru_cache(maxsize=64)
def hand_covers(sections: Sections, palm_width: float = PALM_WIDTH) -> Covers:
    """Return the covers of all components of a box.

    A palm on a long face, centred over its section, sweeps the space outside that face, and so does its approach:
    in another section no second palm fits on that face when the sections' centres are closer than `palm_width` (m).
    A palm on an end cap lies and approaches beyond the end and overhangs nothing.
    """
    stations = sections.stations
    centers = [(low + high) / 2.0 for low, high in zip(stations, stations[1:], strict=False)]
    return _covers(tuple(tuple(abs(a - b) < palm_width for b in centers) for a in centers))


@cache
def _covers(near: tuple[tuple[bool, ...], ...]) -> Covers:
    used, caps, axis = component_masks(), end_caps(2), 2
    covered: list[int] = []
    for component, mask in zip(all_components(axis), used, strict=True):
        for section in range(SECTIONS):
            if component.palm not in caps and near[component.section][section]:
                mask |= bits_of(axis, (section, component.palm))
        covered.append(mask)
    compatible = tuple(
        sum(1 << j for j in range(len(used)) if not (used[i] & covered[j] or used[j] & covered[i]))
        for i in range(len(used))
    )
    return Covers(used, tuple(covered), compatible)
