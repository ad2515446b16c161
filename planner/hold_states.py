"""Sets of hold states: which component the right and which the left hand may have at one moment, as bits."""

from __future__ import annotations

from dataclasses import dataclass
from operator import and_, or_

from preshape.planner.component import EVERY, component_masks
from preshape.planner.hand_cover import Covers

OFF = len(component_masks())
"""The state of a hand that is not on the box, beside the numbers of components."""

OFF_BIT = 1 << OFF

States = tuple[int, ...]
"""Row r, bit l: the pair (r, l) belongs to the set; both run over the components and OFF."""

NO_STATES: States = (0,) * (OFF + 1)


@dataclass(frozen=True, slots=True)
class Onto:
    """How one hand changes in an added regrasp: the components allowed for itself and for the other hand in it.

    `right`: whether the right hand regrasps. `helper`: whether the other hand, off the box, takes it meanwhile.
    """

    right: bool
    own: int
    other: int
    helper: bool


def union(a: States, b: States) -> States:
    """Return the union of two sets."""
    return tuple(map(or_, a, b))


def intersection(a: States, b: States) -> States:
    """Return the intersection of two sets."""
    return tuple(map(and_, a, b))


def possible(covers: Covers, right: int, left: int) -> States:
    """Return the states whose hands are both allowed and compatible with each other."""
    partners = (*covers.compatible, EVERY)
    return tuple(left & (partners[r] | OFF_BIT) if right >> r & 1 else 0 for r in range(OFF + 1))


def left_box(states: States, right: bool, left: bool) -> States:
    """Return the states after the right or the left hand has left the box."""
    if left:
        states = tuple(OFF_BIT if row else 0 for row in states)
    if right:
        reached = 0
        for row in states:
            reached |= row
        states = (*NO_STATES[:OFF], reached)
    return states


def arrived(states: States, right: bool, left: bool) -> States:
    """Return the states after the right or the left hand, off the box so far, has come to any component."""
    if left:
        states = tuple(EVERY if row & OFF_BIT else 0 for row in states)
    if right:
        states = (*(states[OFF],) * OFF, 0)
    return states


def regrasped(states: States, covers: Covers, onto: Onto) -> States:
    """Return the states after one added regrasp."""
    own, other = onto.own, onto.other
    if onto.helper:
        reached = own & covers.supported(covers.supported(_alone(states, onto)) & other)
        if not onto.right:
            return (*NO_STATES[:OFF], reached)
        return (*(OFF_BIT if reached >> r & 1 else 0 for r in range(OFF)), 0)
    if not onto.right:
        partners = (*covers.compatible, EVERY)
        return tuple(own & partners[r] if other >> r & 1 and row & own else 0 for r, row in enumerate(states))
    kept = 0
    for r in range(OFF):
        kept |= states[r] if own >> r & 1 else 0
    kept &= other
    return (*(kept & (covers.compatible[r] | OFF_BIT) if own >> r & 1 else 0 for r in range(OFF)), 0)


def _alone(states: States, onto: Onto) -> int:
    """Return the components of the regrasping hand in which it is on the box by itself."""
    if not onto.right:
        return states[OFF] & onto.own
    return sum(1 << r for r in range(OFF) if onto.own >> r & 1 and states[r] & OFF_BIT)


def before_regrasp(states: States, covers: Covers, onto: Onto, after: tuple[int, int]) -> tuple[int, int] | None:
    """Return a state of the set that one added regrasp turns into `after`, None if there is none."""
    new, other = after if onto.right else (after[1], after[0])
    for old in range(OFF):
        before = (old, other) if onto.right else (other, old)
        if not (onto.own >> old & 1 and onto.own >> new & 1 and states[before[0]] >> before[1] & 1):
            continue
        if onto.helper:
            possible = covers.compatible[old] & covers.compatible[new] & onto.other != 0
        else:
            possible = bool(onto.other >> other & 1 and (other == OFF or covers.compatible[new] >> other & 1))
        if possible:
            return before
    return None
