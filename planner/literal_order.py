"""Which order of priorities leaves every hand an area in the literal reading: exact, by recursion over a forest."""

from __future__ import annotations

from typing import NamedTuple

from preshape.planner.component import surviving

Recipes = dict[int, tuple[int, ...]]
"""Possible region of a grasp -> each child's region if it goes first for that, else `AFTER`."""
_Choice = tuple[int, tuple[int, ...]]
AFTER = -1


class GraspSpan(NamedTuple):
    """One grasp: its first and last task, its hand, the patches free of given areas, the components allowed."""

    first: int
    last: int
    hand: int
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
    """Grasps that share tasks. They form a forest, so every choice of who goes first in each pair is an order.

    In order of time each grasp hangs on the one that the other hand has when it begins, if there is one: whoever it
    meets besides begins later, and hangs on it. Two grasps of one hand share a task only where it regrasps, and of
    those who begin there a helper ends first: it hangs on the old grasp, and the new one on it.
    """

    def __init__(self, spans: tuple[GraspSpan, ...], subtrees: Subtrees | None = None) -> None:
        """Find out who hangs on whom; forests of one search share their `subtrees`."""
        self._spans = spans
        self._subtrees = Subtrees() if subtrees is None else subtrees
        self._by_time = sorted(range(len(spans)), key=spans.__getitem__)
        self._children: list[list[int]] = [[] for _ in spans]
        self._roots: list[int] = []
        newest = [-1, -1]
        for index in self._by_time:
            first, _, hand, _, _ = spans[index]
            other = newest[1 - hand]
            hangs = other >= 0 and spans[other].last >= first
            (self._children[other] if hangs else self._roots).append(index)
            newest[hand] = index

    def complete(self) -> bool:
        """Return whether some order leaves each grasp a component."""
        for _, _, _, free, allowed in self._spans:
            if not surviving(free) & allowed:
                return False
        if not all([self._led(root) for root in self._roots]):
            return False
        numbers = self._numbers()
        return all([self._subtrees.regions(numbers[root], 0) for root in self._roots])

    def _led(self, index: int, above: int = -1) -> bool:
        """Return False if no grasp of a subtree, `above` it another, can be the highest of all.

        The highest has all that is free for it, and each grasp that it meets a component in what that leaves.
        """
        spans, children = self._spans, self._children[index]
        free = ~spans[index].free
        for met in children if above < 0 else (*children, above):
            _, _, _, region, allowed = spans[met]
            if not surviving(region & free) & allowed:
                return any([self._led(child, index) for child in children])
        return True

    def order(self) -> tuple[int, ...] | None:
        """Return an order of the grasps, highest priority first, that leaves each a component; None if none does."""
        if not self.complete():
            return None
        numbers, order = self._numbers(), list[int]()
        for root in self._roots:
            order += self._ordered(numbers, root, 0, next(iter(self._subtrees.regions(numbers[root], 0))))
        return tuple(order)

    def _numbers(self) -> list[int]:
        """Return the number of the subtree of each grasp."""
        numbers = [-1] * len(self._spans)
        for index in reversed(self._by_time):
            span = self._spans[index]
            below = tuple([numbers[child] for child in self._children[index]])
            numbers[index] = self._subtrees.number(span.free, span.allowed, below)
        return numbers

    def _ordered(self, numbers: list[int], index: int, taken: int, region: int) -> list[int]:
        """Return an order of a subtree in which its root has a region that it can have."""
        recipe = self._subtrees.regions(numbers[index], taken)[region]
        before: list[int] = []
        after: list[int] = []
        for child, mask in zip(self._children[index], recipe, strict=True):
            if mask != AFTER:
                before += self._ordered(numbers, child, 0, mask)
            else:
                below = self._subtrees.regions(numbers[child], region)
                after += self._ordered(numbers, child, region, next(iter(below)))
        return [*before, index, *after]
