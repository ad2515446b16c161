"""Who is repelled, who moves and who may or must touch, phase by phase, as one table of data.

A cell is (phase, kind of body, member of the hand) -> `Rule`. Members are the palm (B1), the thumb (B2) and
the fingers of B3 one by one, since a grasp or a pinch uses only some of them. A finger that the plan does
not use must not touch anything: where its row would let it touch, its joints are repelled instead.

The base follows the members whose rule says so; the paper's three motions concern the object, while other
things (the other hand, arms, table, obstacles) push the base as long as the paper lets anything push it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cache

import numpy as np
from numpy.typing import NDArray

from preshape.control.field import FieldGains
from preshape.control.groups import MEMBERS, PART_MEMBERS, Member, group_of
from preshape.control.obstacles import Kind, Obstacles
from preshape.hal.layout import SIDES, Side
from preshape.hal.transform import Matrix


class Phase(StrEnum):
    """What a hand is about to do with the object."""

    APPROACH = "approach"
    """The paper's first motion: bring the hand near; the reciprocal force moves the base only."""
    PRESHAPE = "preshape"
    """The second: base and joints."""
    NEAR = "near"
    """The second, close to the desired state: joints only."""
    GRASP = "grasp"
    """The third: close, hold, carry; nothing meant to touch is repelled."""
    BEFORE_CONTACT = "before_contact"
    """Tasks 4 and 5: the thumb is to meet the opening; base and B3 are repelled."""
    AFTER_CONTACT = "after_contact"
    """The thumb touches: only B3's joints are repelled."""
    PINCH = "pinch"
    """The thumb is inside: fore and middle must touch the opening's outer face too; nothing pushes them off it."""


class Contact(StrEnum):
    """What a touch between a member and a kind of body is."""

    AVOID = "avoid"
    MAY = "may"
    MUST = "must"


@dataclass(frozen=True, slots=True)
class Rule:
    """One cell: the repulsive force's gains on the hand base and on the member's own joints, and the contact."""

    base: float
    joints: float
    contact: Contact


_FREE = Rule(1.0, 1.0, Contact.AVOID)
_BASE = Rule(1.0, 0.0, Contact.AVOID)
_JOINTS = Rule(0.0, 1.0, Contact.AVOID)
_STILL = Rule(0.0, 0.0, Contact.AVOID)
_MAY = Rule(0.0, 0.0, Contact.MAY)
_MUST = Rule(0.0, 0.0, Contact.MUST)

Row = tuple[Rule, Rule, Rule, Rule, Rule]
"""Rules of palm, thumb, fore, middle, ring."""


def _row(palm: Rule, thumb: Rule, *fingers: Rule) -> Row:
    fore, middle, ring = fingers if len(fingers) == 3 else fingers * 3
    return palm, thumb, fore, middle, ring


_TABLE: dict[Phase, dict[Kind, Row]] = {
    Phase.APPROACH: {
        Kind.OBJECT: _row(_BASE, _BASE, _BASE),
        Kind.OPENING: _row(_BASE, _BASE, _BASE),
        Kind.ROBOT: _row(_BASE, _BASE, _BASE),
        Kind.ENVIRONMENT: _row(_BASE, _BASE, _BASE),
    },
    Phase.PRESHAPE: {
        Kind.OBJECT: _row(_BASE, _FREE, _FREE),
        Kind.OPENING: _row(_BASE, _FREE, _FREE),
        Kind.ROBOT: _row(_BASE, _FREE, _FREE),
        Kind.ENVIRONMENT: _row(_BASE, _FREE, _FREE),
    },
    Phase.NEAR: {
        Kind.OBJECT: _row(_STILL, _JOINTS, _JOINTS),
        Kind.OPENING: _row(_STILL, _JOINTS, _JOINTS),
        Kind.ROBOT: _row(_BASE, _FREE, _FREE),
        Kind.ENVIRONMENT: _row(_BASE, _FREE, _FREE),
    },
    Phase.GRASP: {
        Kind.OBJECT: _row(_MAY, _MUST, _MUST),
        Kind.OPENING: _row(_BASE, _BASE, _BASE),
        Kind.ROBOT: _row(_BASE, _BASE, _BASE),
        Kind.ENVIRONMENT: _row(_BASE, _BASE, _BASE),
    },
    Phase.BEFORE_CONTACT: {
        Kind.OBJECT: _row(_BASE, _MAY, _FREE),
        Kind.OPENING: _row(_BASE, _MUST, _FREE),
        Kind.ROBOT: _row(_BASE, _FREE, _FREE),
        Kind.ENVIRONMENT: _row(_BASE, _FREE, _FREE),
    },
    Phase.AFTER_CONTACT: {
        Kind.OBJECT: _row(_STILL, _MAY, _JOINTS),
        Kind.OPENING: _row(_STILL, _MUST, _JOINTS),
        Kind.ROBOT: _row(_STILL, _STILL, _JOINTS),
        Kind.ENVIRONMENT: _row(_STILL, _STILL, _JOINTS),
    },
    Phase.PINCH: {
        Kind.OBJECT: _row(_STILL, _MAY, _STILL, _STILL, _JOINTS),
        Kind.OPENING: _row(_STILL, _MUST, _MUST, _MUST, _JOINTS),
        Kind.ROBOT: _row(_STILL, _STILL, _STILL, _STILL, _JOINTS),
        Kind.ENVIRONMENT: _row(_STILL, _STILL, _STILL, _STILL, _JOINTS),
    },
}


def rule(phase: Phase, kind: Kind, member: Member, used: frozenset[Member] = frozenset(MEMBERS)) -> Rule:
    """Return the rule of one cell, given the members that the plan uses (all, unless told)."""
    cell = _TABLE[phase][kind][MEMBERS.index(member)]
    if cell.contact is not Contact.AVOID and group_of(member) == "fingers" and member not in used:
        return _JOINTS
    return cell


def is_left_out(phase: Phase, kind: Kind, member: Member, used: frozenset[Member] = frozenset(MEMBERS)) -> bool:
    """Tell whether a member does not count in its group's minimum.

    A member that may touch never counts. One that must not touch, but moves nothing, counts only when no
    other member of its group moves anything: then it is measured for telemetry and cannot mask another.
    """
    cell = rule(phase, kind, member, used)
    if cell.contact is not Contact.AVOID:
        return True
    if cell.base > 0.0 or cell.joints > 0.0:
        return False
    others = [rule(phase, kind, other, used) for other in MEMBERS if group_of(other) == group_of(member)]
    return any(other.base > 0.0 or other.joints > 0.0 for other in others)


def apply_policy(
    gains: FieldGains,
    obstacles: Obstacles,
    side: Side,
    phase: Phase,
    used: frozenset[Member] = frozenset(MEMBERS),
    settled: float = 0.0,
) -> None:
    """Write the gains of one hand against every body for a phase.

    `settled` in 0 .. 1 blends a PRESHAPE hand into NEAR: the base's gains fade from the one to the other.
    `ValueError` when it is out of range or asked of another phase.
    """
    if not 0.0 <= settled <= 1.0 or (settled > 0.0 and phase is not Phase.PRESHAPE):
        raise ValueError(f"settled: got {settled} in phase {phase}, allowed is 0 .. 1 in phase preshape, else 0")
    hand, kinds = SIDES.index(side), tuple(obstacles.kinds)
    base, joints, left_out = _gains(phase, kinds, used)
    if settled > 0.0:
        near_base, near_joints, _ = _gains(Phase.NEAR, kinds, used)
        base, joints = base + settled * (near_base - base), joints + settled * (near_joints - joints)
    gains.base[hand, :, : len(kinds)] = base
    gains.joints[hand, :, : len(kinds)] = joints
    gains.ignored[hand, :, : len(kinds)] = left_out


@cache
def _gains(phase: Phase, kinds: tuple[Kind, ...], used: frozenset[Member]) -> tuple[Matrix, Matrix, NDArray[np.bool_]]:
    """Return a phase's gains on base and joints, and who is left out of the minimum, each (members, bodies)."""
    cells = [[rule(phase, kind, member, used) for kind in kinds] for member in MEMBERS]
    return (
        np.array([[cell.base for cell in row] for row in cells]),
        np.array([[cell.joints for cell in row] for row in cells]),
        np.array([[is_left_out(phase, kind, member, used) for kind in kinds] for member in MEMBERS]),
    )


def members_that(contact: Contact, phase: Phase, kind: Kind, used: frozenset[Member]) -> frozenset[Member]:
    """Return the members whose touch with a kind of body is such in a phase."""
    return frozenset(member for member in MEMBERS if rule(phase, kind, member, used).contact is contact)


def allowed_parts(phase: Phase, kind: Kind, used: frozenset[Member] = frozenset(MEMBERS)) -> tuple[bool, ...]:
    """Return for each part b1 .. b18 whether it may (or must) touch a kind of body."""
    return tuple(rule(phase, kind, member, used).contact is not Contact.AVOID for member in PART_MEMBERS)


class Settling:
    """How far a hand has settled at its goal, 0 .. 1, with hysteresis: the blend of `apply_policy`.

    It is 1 at an error of `inner` and 0 at `outer` (in one measure, e.g. m). Once 1 it stays 1 until the
    error exceeds `outer`, so that noise at the threshold does not switch the base on and off.
    """

    def __init__(self, inner: float, outer: float) -> None:
        """Take both thresholds; `ValueError` unless 0 < inner < outer."""
        if not 0.0 < inner < outer:
            raise ValueError(f"inner, outer: got {inner}, {outer}, allowed is 0 < inner < outer")
        self._inner, self._outer = inner, outer
        self._latched = False

    def update(self, error: float) -> float:
        """Return the blend for the present error."""
        self._latched = error <= self._inner or (self._latched and error <= self._outer)
        if self._latched:
            return 1.0
        return float(min(max((self._outer - error) / (self._outer - self._inner), 0.0), 1.0))
