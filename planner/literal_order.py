"""Which order of priorities leaves every hand an area in the literal reading: exact, by recursion over a forest."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

from preshape.planner.component import surviving

_Ways = dict[int, tuple[int, ...]]
"""Possible region of a grasp -> an order of its subtree that gives it."""


@dataclass(frozen=True, slots=True)
class GraspSpan:
    """One grasp: its hand, its first and last task, the patches free of given areas, the components allowed."""

    hand: int
    first: int
    last: int
    free: int
    allowed: int

    def meets(self, other: GraspSpan) -> bool:
        """Return whether the other hand's grasp shares a task with this one."""
        return self.hand != other.hand and self.first <= other.last and other.first <= self.last


class GraspForest:
    """Grasps that share tasks. They form a forest, so every choice of who goes first in each pair is an order."""

    def __init__(self, spans: tuple[GraspSpan, ...]) -> None:
        self._spans = spans
        self._meets = [[k for k, other in enumerate(spans) if span.meets(other)] for span in spans]
        self._known: dict[tuple[int, int, int], _Ways] = {}

    def order(self) -> tuple[int, ...] | None:
        """Return an order of the grasps, highest priority first, that leaves each a component; None if none does."""
        if not all(surviving(span.free) & span.allowed for span in self._spans):
            return None
        order: list[int] = []
        for root in range(len(self._spans)):
            if root not in order:
                ways = self._ways(root, -1, 0)
                if not ways:
                    return None
                order += next(iter(ways.values()))
        return tuple(order)

    def _ways(self, index: int, parent: int, taken: int) -> _Ways:
        """Return all regions of a grasp with the subtree away from `parent` complete.

        `taken` is the parent's region if the parent goes first, else 0.
        """
        key = (index, parent, taken)
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = self._found(index, parent, taken)
        return found

    def _found(self, index: int, parent: int, taken: int) -> _Ways:
        span, found = self._spans[index], _Ways()
        start = span.free & ~taken
        if not surviving(start) & span.allowed:
            return found
        children = [child for child in self._meets[index] if child != parent]
        if not children:
            return {start: (index,)}
        for first in product((False, True), repeat=len(children)):
            before = [self._ways(child, index, 0) for child, higher in zip(children, first, strict=True) if higher]
            after = [child for child, higher in zip(children, first, strict=True) if not higher]
            for choice in product(*before):
                region = start
                for mask in choice:
                    region &= ~mask
                if region in found or not surviving(region) & span.allowed:
                    continue
                below = [self._ways(child, index, region) for child in after]
                if all(below):
                    higher = [b for ways, mask in zip(before, choice, strict=True) for b in ways[mask]]
                    lower = [b for ways in below for b in next(iter(ways.values()))]
                    found[region] = (*higher, index, *lower)
        return found
