"""Which order of priorities leaves every hand an area in the literal reading: exact, by recursion over a forest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from preshape.planner.component import surviving

_Ways = dict[int, tuple[int, ...]]
"""Possible region of a grasp -> an order of its subtree that gives it."""


class GraspSpan(NamedTuple):
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
        self._meets: list[list[int]] = [[] for _ in spans]
        for i, (hand, first, last, _, _) in enumerate(spans):
            for j in range(i):
                other = spans[j]
                if hand != other.hand and first <= other.last and other.first <= last:
                    self._meets[i].append(j)
                    self._meets[j].append(i)
        self._known: dict[tuple[int, int, int], _Ways] = {}

    def order(self) -> tuple[int, ...] | None:
        """Return an order of the grasps, highest priority first, that leaves each a component; None if none does."""
        spans, order = self._spans, list[int]()
        if not all([surviving(span.free) & span.allowed for span in spans]):
            return None
        for tree in self._trees():
            ways = self._ways(tree[0], -1, 0) if self._has_top(tree) else None
            if not ways:
                return None
            order += next(iter(ways.values()))
        return tuple(order)

    def _trees(self) -> Iterator[list[int]]:
        """Yield the grasps that hang together, tree by tree."""
        seen = set[int]()
        for root, meets in enumerate(self._meets):
            if root not in seen:
                tree = [root]
                for index in tree if meets else ():
                    tree += [other for other in self._meets[index] if other not in tree]
                seen.update(tree)
                yield tree

    def _has_top(self, tree: list[int]) -> bool:
        """Return False if no grasp of a tree can be its highest one, and so no order is possible.

        The highest one keeps all that is free of given areas: what it meets must do with the rest.
        """
        for index in tree:
            rest = ~self._spans[index].free
            for other in self._meets[index]:
                if not surviving(self._spans[other].free & rest) & self._spans[other].allowed:
                    break
            else:
                return True
        return False

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
        span = self._spans[index]
        start = span.free & ~taken
        if not surviving(start) & span.allowed:
            return {}
        children = [child for child in self._meets[index] if child != parent]
        if not children:
            return {start: (index,)}
        # Region and children that go after this grasp -> the order of all that goes before it.
        choices: dict[tuple[int, tuple[int, ...]], tuple[int, ...]] = {(start, ()): ()}
        for child in children:
            above = self._ways(child, index, 0)
            longer: dict[tuple[int, tuple[int, ...]], tuple[int, ...]] = {}
            for (region, after), before in choices.items():
                longer[region, (*after, child)] = before
                for mask, order in above.items():
                    left = region & ~mask
                    if surviving(left) & span.allowed:
                        longer.setdefault((left, after), (*before, *order))
            choices = longer
        found = _Ways()
        for (region, after), before in choices.items():
            below = None if region in found else self._below(index, region, after)
            if below is not None:
                found[region] = (*before, index, *below)
        return found

    def _below(self, index: int, region: int, children: tuple[int, ...]) -> list[int] | None:
        """Return an order of the subtrees of children that go after a grasp with this region; None if there is none."""
        order: list[int] = []
        for child in children:
            ways = self._ways(child, index, region)
            if not ways:
                return None
            order += next(iter(ways.values()))
        return order
