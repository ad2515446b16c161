"""Which order of priorities leaves every hand an area in the literal reading: exact, by who can be the highest."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from preshape.hal.compiled import compiled
from preshape.planner.component import component_masks
from preshape.planner.region import WHOLE

Ints = NDArray[np.int64]
_FREE, _ALLOWED = 3, 4
"""Columns of grasps as an array; they stand as in `GraspSpan`."""


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


def grasp_order(spans: Sequence[GraspSpan]) -> tuple[int, ...] | None:
    """Return an order of grasps that leaves each a component, highest priority first; None if there is none.

    What hangs together is a tree (see `_edges`). Its highest grasp takes all that is free for it; what it meets has
    less free then, and the tree without it falls apart into smaller ones. Each grasp is tried as the highest.
    """
    order = np.empty(len(spans), np.int64)
    found = _find(np.array(spans, np.int64), _components(), order)
    return tuple(order.tolist()) if found else None


@cache
def _components() -> Ints:
    """Return, for every region (bits), the components that have all three patches in it, as bits."""
    regions, found = np.arange(WHOLE + 1), np.zeros(WHOLE + 1, np.int64)
    for number, mask in enumerate(component_masks()):
        found |= (mask & ~regions == 0).astype(np.int64) << number
    return found


@compiled
def _find(spans: Ints, components: Ints, order: Ints) -> bool:
    """Write an order of all grasps, if there is one."""
    for k in range(len(spans)):
        if components[spans[k, _FREE]] & spans[k, _ALLOWED] == 0:
            return False
    roots, sides = _edges(spans)
    done = 0
    for root in roots:
        if root:
            done = _led(root, spans[:, _FREE].copy(), spans[:, _ALLOWED], sides, components, order, done)
            if done < 0:
                return False
    return True


@compiled
def _edges(spans: Ints) -> tuple[Ints, Ints]:
    """Return the trees that the grasps form, and for each two that meet what hangs on the second then; as bits.

    In order of time each grasp hangs on the one that the other hand has when it begins, if there is one: whoever it
    meets besides begins later, and hangs on it. Two grasps of one hand share a task only where it regrasps, and of
    those who begin there a helper ends first: it hangs on the old grasp, and the new one on it.
    """
    count = len(spans)
    by_time = np.arange(count)
    for k in range(1, count):
        while k and _earlier(spans[by_time[k]], spans[by_time[k - 1]]):
            by_time[k], by_time[k - 1] = by_time[k - 1], by_time[k]
            k -= 1
    above, newest = np.full(count, -1), np.full(2, -1)
    for index in by_time:
        first, hand = spans[index, 0], spans[index, 2]
        other = newest[1 - hand]
        if other >= 0 and spans[other, 1] >= first:
            above[index] = other
        newest[hand] = index
    roots, below, sides = np.zeros(count, np.int64), np.zeros(count, np.int64), np.zeros((count, count), np.int64)
    for k in range(count - 1, -1, -1):
        index = by_time[k]
        below[index] |= 1 << index
        upper = above[index]
        if upper < 0:
            roots[index] = below[index]
        else:
            below[upper] |= below[index]
            sides[upper, index], sides[index, upper] = below[index], ~below[index]
    return roots, sides


@compiled
def _earlier(one: Ints, other: Ints) -> bool:
    for k in range(3):
        if one[k] != other[k]:
            return one[k] < other[k]
    return False


@compiled
def _led(tree: int, free: Ints, allowed: Ints, sides: Ints, components: Ints, order: Ints, done: int) -> int:
    """Write an order of a tree behind the `done` first; return how many it are then, -1 if the tree has none."""
    count = len(free)
    if tree & (tree - 1) == 0:
        for k in range(count):
            if tree == 1 << k:
                order[done] = k
        return done + 1
    for highest in range(count):
        if not tree >> highest & 1:
            continue
        leads = True
        for met in range(count):
            if sides[highest, met] & tree and components[free[met] & ~free[highest]] & allowed[met] == 0:
                leads = False
                break
        if not leads:
            continue
        left, after = free.copy(), done + 1
        order[done] = highest
        for met in range(count):
            if sides[highest, met] & tree:
                left[met] &= ~free[highest]
        for met in range(count):
            if sides[highest, met] & tree:
                after = _led(sides[highest, met] & tree, left, allowed, sides, components, order, after)
                if after < 0:
                    break
        if after >= 0:
            return after
    return -1
