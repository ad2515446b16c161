"""What each hand has in each task: whether it keeps a grasp there, and what the areas given to others leave it."""

from __future__ import annotations

from collections.abc import Callable

from preshape.planner.area_problem import AreaProblem
from preshape.planner.component import surviving
from preshape.planner.procedure import Block, Hand, Task
from preshape.planner.region import WHOLE

Limits = tuple[int, int]
"""Patches free of the areas given to others, components allowed among them; both as bits."""


class TaskAreas:
    """The grasps and the given areas of a problem, looked up once."""

    def __init__(self, problem: AreaProblem, taken: Callable[[Block], int]) -> None:
        """Keep the patches that each given area takes: `problem.wanted` or, with what is swept, `problem.kept_out`."""
        self._problem = problem
        blocks = problem.procedure.blocks
        self._grasps = [(b.resource, b.first, b.last) for b in blocks if b.want == "grasp"]
        self._given = [(b.resource, b.first, b.last, taken(b)) for b in blocks if b.want != "grasp"]

    def keeps(self, hand: Hand, first: int, last: int) -> bool:
        """Return whether a hand keeps one grasp over all tasks first .. last."""
        for resource, begin, end in self._grasps:
            if resource == hand and begin <= first and last <= end:
                return True
        return False

    def limits(self, hand: Hand, task: Task, first: int, last: int) -> Limits:
        """Return a hand's limits in a task, beside the areas that are given to others in all tasks first .. last."""
        free = WHOLE
        for resource, begin, end, mask in self._given:
            if resource != hand and begin <= first and last <= end:
                free &= ~mask
        return free, self._problem.allowed(hand, task, among=surviving(free))
