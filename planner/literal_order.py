"""Which order of priorities leaves every hand an area in the literal reading: exact, by recursion over a forest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from preshape.planner.component import surviving

_Ways = dict[int, tuple[int, ...]]
"""Possible region of a grasp -> an order of its subtree that gives it."""
_Choice = tuple[int, tuple[int, ...], tuple[int, ...]]


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
        span, meets = self._spans[index], self._meets[index]
        start = span.free & ~taken
        if not surviving(start) & span.allowed:
            return {}
        if meets == [parent]:
            return {start: (index,)}
        found = self._known.get((index, parent, start))
        if found is None:
            children = [child for child in meets if child != parent]
            found = self._known[index, parent, start] = self._found(index, start, children)
        return found

    def _found(self, index: int, start: int, children: list[int]) -> _Ways:
        allowed = self._spans[index].allowed
        # Regions, with the children that go after this grasp and the order of all that goes before it.
        choices: list[_Choice] = [(start, (), ())]
        for child in children:
            above = self._ways(child, index, 0)
            longer: list[_Choice] = [(region, (*after, child), before) for region, after, before in choices]
            for mask, order in above.items():
                for region, after, before in choices:
                    if surviving(region & ~mask) & allowed:
                        longer.append((region & ~mask, after, (*before, *order)))
            choices = longer
        found = _Ways()
        for region, after, before in choices:
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
