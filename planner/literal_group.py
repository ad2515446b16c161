"""Grasps that hang together by the tasks they share, and what added regrasps make of them (the literal reading)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

from preshape.planner.area_problem import AreaProblem
from preshape.planner.literal_order import GraspSpan
from preshape.planner.procedure import HANDS, Block, Hand, Task
from preshape.planner.region import WHOLE
from preshape.planner.regrasp_move import Move, needs_helper, regrasp_task
from preshape.planner.task_areas import Limits, TaskAreas

BothLimits = tuple[Limits, Limits]
"""The right and the left hand's."""
NO_GRASP: Limits = (WHOLE, 0)


class Cut(NamedTuple):
    """A regrasp of one hand between two tasks: whether a helper is needed, and the limits per hand in it."""

    helper: bool
    limits: BothLimits


class GraspGroup(NamedTuple):
    """Grasps that hang together: limits per task and hand, cuts per place and hand (None: impossible), spans.

    Tasks are counted from the group's first one, which is the procedure's task `start` + 1. Regrasps are added in
    order of time, the next one after task `added` at the earliest: so each way to add them comes up once.
    """

    start: int
    tasks: tuple[BothLimits, ...]
    cuts: tuple[tuple[Cut | None, Cut | None], ...]
    spans: tuple[GraspSpan, ...]
    moves: tuple[Move, ...] = ()
    added: int = 1

    @property
    def shares(self) -> bool:
        """Whether both hands grasp in some task."""
        return any(a.meets(b) for a, b in combinations(self.spans, 2))

    def longer(self) -> Iterator[GraspGroup]:
        """Yield the groups with one more regrasp."""
        for after in range(self.added, len(self.tasks)):
            for hand, cut in enumerate(self.cuts[after - 1]):
                if cut is not None and any([s.hand == hand and s.first <= after < s.last for s in self.spans]):
                    yield self._with(hand, after, cut)

    def _with(self, hand: int, after: int, cut: Cut) -> GraspGroup:
        added = after + 1
        tasks = (*self.tasks[:after], cut.limits, *self.tasks[after:])
        spans: list[GraspSpan] = []
        for span in self.spans:
            first, last, side, free, allowed = span
            if last <= after:
                spans.append(span)
            elif first > after:
                spans.append(GraspSpan(first + 1, last + 1, side, free, allowed))
            elif side == hand:
                spans += (_span(tasks, hand, first, added), _span(tasks, hand, added, last + 1))
            else:
                beside, left = cut.limits[side]
                spans.append(GraspSpan(first, last + 1, side, free & beside, allowed & left))
        if cut.helper:
            spans.append(GraspSpan(added, added, 1 - hand, *cut.limits[1 - hand]))
        cuts = (*self.cuts[:after], self.cuts[after - 1], *self.cuts[after:])
        move: Move = (HANDS[hand], self.start + after)
        return GraspGroup(self.start, tasks, cuts, tuple(spans), (*self.moves, move), added)


def _span(tasks: Sequence[BothLimits], hand: int, first: int, last: int) -> GraspSpan:
    """Return a grasp over these tasks with what is free and allowed over all of them."""
    free, allowed = WHOLE, -1
    for limits in tasks[first - 1 : last]:
        free &= limits[hand][0]
        allowed &= limits[hand][1]
    return GraspSpan(first, last, hand, free, allowed)


def grasp_groups(problem: AreaProblem) -> list[GraspGroup]:
    """Return what hangs together, in order of time."""
    areas, groups = TaskAreas(problem, problem.wanted), list[GraspGroup]()
    together: list[Block] = []
    last = 0
    for block in sorted((b for b in problem.procedure.blocks if b.want == "grasp"), key=lambda b: b.first):
        if together and block.first > last:
            groups.append(_group(problem, areas, together))
            together = []
        together.append(block)
        last = max(last, block.last)
    return [*groups, _group(problem, areas, together)] if together else groups


def _group(problem: AreaProblem, areas: TaskAreas, blocks: list[Block]) -> GraspGroup:
    """Return some grasps that hang together; no other grasp shares a task with them."""
    first, last = min(b.first for b in blocks), max(b.last for b in blocks)
    every = problem.procedure.tasks
    tasks = tuple(_limits(areas, every[number - 1], number, number) for number in range(first, last + 1))
    cuts = tuple((_cut(problem, areas, "r", after), _cut(problem, areas, "l", after)) for after in range(first, last))
    places = [(("r", "l").index(b.resource), b.first - first + 1, b.last - first + 1) for b in blocks]
    return GraspGroup(first - 1, tasks, cuts, tuple(_span(tasks, *place) for place in places))


def _cut(problem: AreaProblem, areas: TaskAreas, hand: Hand, after: int) -> Cut | None:
    helper = needs_helper(problem.procedure, hand, after) if areas.keeps(hand, after, after + 1) else None
    if helper is None:
        return None
    task = regrasp_task(hand, problem.procedure.tasks[after - 1].holder)
    return Cut(helper, _limits(areas, task, after, after + 1, helper))


def _limits(areas: TaskAreas, task: Task, first: int, last: int, both: bool = False) -> BothLimits:
    right, left = HANDS
    return (
        areas.limits(right, task, first, last) if both or areas.keeps(right, first, last) else NO_GRASP,
        areas.limits(left, task, first, last) if both or areas.keeps(left, first, last) else NO_GRASP,
    )
