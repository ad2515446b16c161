"""The fewest added regrasps in the literal reading: all ways to add them, each with all orders of priorities."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

from preshape.planner.area_problem import AreaProblem
from preshape.planner.component import surviving
from preshape.planner.literal_order import GraspForest, GraspSpan
from preshape.planner.procedure import HANDS, Block, Hand, Procedure
from preshape.planner.region import WHOLE
from preshape.planner.regrasp_move import needs_helper, regrasp_task

Move = tuple[Hand, int]
"""A regrasp of a hand after a task, numbered as when it is added."""

_Limits = tuple[tuple[int, int], tuple[int, int]]
"""Per hand: patches free of given areas, components allowed."""


@dataclass(frozen=True, slots=True)
class _Cut:
    """What a regrasp between two tasks would be: per hand whether a helper is needed (None: impossible), its limits."""

    helper: tuple[bool | None, bool | None]
    limits: tuple[_Limits, _Limits]


@dataclass(frozen=True, slots=True)
class _Variant:
    """What regions depend on in a procedure: limits per task, cuts between tasks, grasps as (hand, first, last)."""

    tasks: tuple[_Limits, ...]
    cuts: tuple[_Cut, ...]
    grasps: tuple[tuple[int, int, int], ...]
    moves: tuple[Move, ...] = ()

    def spans(self) -> tuple[GraspSpan, ...]:
        """Return the grasps with what is free and allowed over all their tasks."""
        found: list[GraspSpan] = []
        for hand, first, last in self.grasps:
            free, allowed = WHOLE, -1
            for limits in self.tasks[first - 1 : last]:
                free &= limits[hand][0]
                allowed &= limits[hand][1]
            found.append(GraspSpan(hand, first, last, free, allowed))
        return tuple(found)

    @property
    def shares(self) -> bool:
        """Whether both hands grasp in some task."""
        return any(a[0] < b[0] and a[1] <= b[2] and b[1] <= a[2] for a, b in permutations(self.grasps, 2))

    def longer(self) -> Iterator[_Variant]:
        """Yield the variants with one more regrasp."""
        for after, cut in enumerate(self.cuts, start=1):
            for hand in (0, 1):
                spanning = any(h == hand and first <= after < last for h, first, last in self.grasps)
                if spanning and cut.helper[hand] is not None:
                    yield self._with(hand, after, cut)

    def _with(self, hand: int, after: int, cut: _Cut) -> _Variant:
        added = after + 1
        grasps: list[tuple[int, int, int]] = []
        for who, first, last in self.grasps:
            moved = (first + (first > after), last + (last > after))
            if who == hand and first <= after < last:
                grasps += [(who, moved[0], added), (who, added, moved[1])]
            else:
                grasps.append((who, *moved))
        if cut.helper[hand]:
            grasps.append((1 - hand, added, added))
        return _Variant(
            (*self.tasks[:after], cut.limits[hand], *self.tasks[after:]),
            (*self.cuts[:after], cut, *self.cuts[after:]),
            tuple(grasps),
            (*self.moves, (HANDS[hand], after)),
        )


def _free(problem: AreaProblem, hand: Hand, *numbers: int) -> int:
    """Return the patches outside all areas that are given to others in all these tasks."""
    free = WHOLE
    for block in problem.procedure.blocks:
        if block.want != "grasp" and block.resource != hand and block.covers(*numbers):
            free &= ~problem.wanted(block)
    return free


def _cut(problem: AreaProblem, after: int) -> _Cut:
    holder = problem.procedure.tasks[after - 1].holder

    def limits(regrasping: Hand) -> _Limits:
        task = regrasp_task(regrasping, holder)
        free = [(_free(problem, hand, after, after + 1), problem.allowed(hand, task)) for hand in HANDS]
        return free[0], free[1]

    right, left = HANDS
    helper = (needs_helper(problem.procedure, right, after), needs_helper(problem.procedure, left, after))
    return _Cut(helper, (limits(right), limits(left)))


def _start(problem: AreaProblem) -> _Variant:
    procedure = problem.procedure
    tasks: list[_Limits] = []
    for number, task in procedure.numbered():
        free = [(_free(problem, hand, number), problem.allowed(hand, task)) for hand in HANDS]
        tasks.append((free[0], free[1]))
    cuts = tuple(_cut(problem, after) for after in range(1, len(procedure.tasks)))
    grasps = tuple((("r", "l").index(b.resource), b.first, b.last) for b in _grasps(procedure))
    return _Variant(tuple(tasks), cuts, grasps)


def _grasps(procedure: Procedure) -> list[Block]:
    return [b for b in procedure.blocks if b.want == "grasp"]


def literal_order(problem: AreaProblem) -> tuple[Block, ...] | None:
    """Return an order of all blocks in which none is left without an area, None if there is none.

    Given areas go first: an order that leaves a given area whole subtracts nothing from it, so to move it up takes
    nothing from anybody. Given areas of one task must not overlap; the caller has checked that.
    """
    grasps = _grasps(problem.procedure)
    spans: list[GraspSpan] = []
    for block in grasps:
        free = WHOLE
        for other in problem.procedure.meeting(block):
            free &= ~problem.wanted(other) if other.want != "grasp" else WHOLE
        spans.append(
            GraspSpan(("r", "l").index(block.resource), block.first, block.last, free, problem.allowed_in(block))
        )
    order = GraspForest(tuple(spans)).order()
    given = (b for b in problem.procedure.blocks if b.want != "grasp")
    return None if order is None else (*given, *(grasps[k] for k in order))


def fewest_literal_moves(problem: AreaProblem, limit: int) -> tuple[Move, ...] | None:
    """Return the fewest regrasps, at most `limit`, with which some order leaves every grasp a component; else None."""
    variants = [_start(problem)]
    if not _each_alone(variants[0]):
        return None
    can_share = _can_share(variants[0])
    if not can_share and variants[0].shares:
        return None
    for regrasps in range(limit + 1):
        for variant in variants:
            if GraspForest(variant.spans()).order() is not None:
                return variant.moves
        if regrasps == limit:
            break
        longer = (v for shorter in variants for v in shorter.longer() if can_share or not v.shares)
        variants = list({(v.tasks, v.grasps): v for v in longer}.values())
    return None


def _each_alone(variant: _Variant) -> bool:
    """Return False if a grasp has no component in one of its tasks even beside the given areas alone."""
    return all(
        surviving(variant.tasks[number - 1][hand][0]) & variant.tasks[number - 1][hand][1]
        for hand, first, last in variant.grasps
        for number in range(first, last + 1)
    )


def _can_share(variant: _Variant) -> bool:
    """Return False if no two hands can be on the box in one task, however many regrasps are added.

    Of the grasps that meet others, one has no higher one among them. Its region is all but the areas given in its
    tasks, so a grasp that meets it must have a component within those given areas.
    """
    for hand in (0, 1):
        reserved = [WHOLE & ~cut.limits[1 - hand][hand][0] for cut in variant.cuts]
        for who, first, last in variant.grasps:
            if who == hand:
                free = WHOLE
                for limits in variant.tasks[first - 1 : last]:
                    free &= limits[hand][0]
                reserved.append(WHOLE & ~free)
        allowed = 0
        for limits in (*variant.tasks, *(side for cut in variant.cuts for side in cut.limits)):
            allowed |= limits[1 - hand][1]
        if any(surviving(mask) & allowed for mask in reserved):
            return True
    return False
