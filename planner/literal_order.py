"""Which order of priorities leaves every hand an area in the literal reading: exact, by recursion over a forest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from preshape.planner.component import surviving

Recipes = dict[int, tuple[int, ...]]
"""Possible region of a grasp -> each child's region if it goes first for that, else `AFTER`."""
_Choice = tuple[int, tuple[int, ...]]
AFTER = -1


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


class Subtrees:
    """Which regions a grasp can have with all that hangs on it complete, for all forests of one search.

    Forests that differ by a regrasp have most of their subtrees in common. What hangs on a grasp is numbered by what
    it is (free patches, allowed components, numbers of the children), not by where it stands.
    """

    def __init__(self) -> None:
        """Start with no subtree."""
        self._numbers: dict[tuple[int, int, tuple[int, ...]], int] = {}
        self._nodes: list[tuple[int, int, tuple[int, ...]]] = []
        self._known: dict[tuple[int, int], Recipes] = {}

    def number(self, free: int, allowed: int, children: tuple[int, ...]) -> int:
        """Return the number of a subtree."""
        node = free, allowed, children
        number = self._numbers.get(node)
        if number is None:
            number = self._numbers[node] = len(self._nodes)
            self._nodes.append(node)
        return number

    def regions(self, number: int, taken: int) -> Recipes:
        """Return all regions of a subtree's root; `taken` is its parent's if the parent goes first, else 0."""
        free, allowed, children = self._nodes[number]
        start = free & ~taken
        if not surviving(start) & allowed:
            return {}
        if not children:
            return {start: ()}
        found = self._known.get((number, start))
        if found is None:
            found = self._known[number, start] = self._found(start, allowed, children)
        return found

    def _found(self, start: int, allowed: int, children: tuple[int, ...]) -> Recipes:
        choices: list[_Choice] = [(start, ())]
        for child in children:
            longer: list[_Choice] = [(region, (*recipe, AFTER)) for region, recipe in choices]
            for mask in self.regions(child, 0):
                for region, recipe in choices:
                    if surviving(region & ~mask) & allowed:
                        longer.append((region & ~mask, (*recipe, mask)))
            choices = longer
        found = Recipes()
        for region, recipe in choices:
            if region not in found and self._rest_fits(region, children, recipe):
                found[region] = recipe
        return found

    def _rest_fits(self, region: int, children: tuple[int, ...], recipe: tuple[int, ...]) -> bool:
        for child, mask in zip(children, recipe, strict=True):
            if mask == AFTER and not self.regions(child, region):
                return False
        return True


class GraspForest:
    """Grasps that share tasks. They form a forest, so every choice of who goes first in each pair is an order."""

    def __init__(self, spans: tuple[GraspSpan, ...], subtrees: Subtrees | None = None) -> None:
        """Find out who meets whom; forests of one search share their `subtrees`."""
        self._spans = spans
        self._subtrees = Subtrees() if subtrees is None else subtrees
        self._meets: list[list[int]] = [[] for _ in spans]
        for i, (hand, first, last, _, _) in enumerate(spans):
            for j in range(i):
                other = spans[j]
                if hand != other.hand and first <= other.last and other.first <= last:
                    self._meets[i].append(j)
                    self._meets[j].append(i)

    def order(self) -> tuple[int, ...] | None:
        """Return an order of the grasps, highest priority first, that leaves each a component; None if none does."""
        if not all([surviving(span.free) & span.allowed for span in self._spans]):
            return None
        order: list[int] = []
        for root in self._roots():
            regions = self._subtrees.regions(self._subtree(root, -1), 0)
            if not regions:
                return None
            order += self._ordered(root, -1, 0, next(iter(regions)))
        return tuple(order)

    def _roots(self) -> Iterator[int]:
        """Yield one of the grasps that hang together, tree by tree."""
        seen = set[int]()
        for root, meets in enumerate(self._meets):
            if root not in seen:
                tree = [root]
                for index in tree if meets else ():
                    tree += [other for other in self._meets[index] if other not in tree]
                seen.update(tree)
                yield root

    def _children(self, index: int, parent: int) -> list[int]:
        return [child for child in self._meets[index] if child != parent]

    def _subtree(self, index: int, parent: int) -> int:
        free, allowed = self._spans[index][3:]
        children = [self._subtree(child, index) for child in self._children(index, parent)]
        return self._subtrees.number(free, allowed, tuple(children))

    def _ordered(self, index: int, parent: int, taken: int, region: int) -> list[int]:
        """Return an order of a subtree in which its root has a region that it can have."""
        children, recipe = self._children(index, parent), self._subtrees.regions(self._subtree(index, parent), taken)
        before: list[int] = []
        after: list[int] = []
        for child, mask in zip(children, recipe[region], strict=True):
            if mask != AFTER:
                before += self._ordered(child, index, 0, mask)
            else:
                below = self._subtrees.regions(self._subtree(child, index), region)
                after += self._ordered(child, index, region, next(iter(below)))
        return [*before, index, *after]
