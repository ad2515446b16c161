"""The fewest added regrasps in the committed reading: shortest path over what both hands hold, task by task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from preshape.planner.area_problem import AreaProblem
from preshape.planner.hand_cover import Covers
from preshape.planner.hold_states import (
    NO_STATES,
    OFF,
    OFF_BIT,
    Onto,
    States,
    arrived,
    before_regrasp,
    intersection,
    left_box,
    possible,
    regrasped,
    union,
)
from preshape.planner.procedure import HANDS, Hand, Task
from preshape.planner.regrasp_move import Move, needs_helper, regrasp_task
from preshape.planner.task_areas import TaskAreas


@dataclass(frozen=True, slots=True)
class _Task:
    """States possible in a task, which hands are on the box, which of them stay on it after it."""

    states: States
    right: bool
    left: bool
    right_stays: bool
    left_stays: bool


class _Areas:
    """What the hands of a problem may have in its tasks and in regrasps after them, asked for task by task."""

    def __init__(self, problem: AreaProblem) -> None:
        self._problem = problem
        self._areas = TaskAreas(problem, problem.kept_out)

    def _allowed(self, hand: Hand, task: Task, first: int, last: int) -> int:
        return self._areas.limits(hand, task, first, last)[1]

    def task(self, number: int) -> _Task:
        """Return a task as the search sees it."""
        right, left = HANDS
        task = self._problem.procedure.tasks[number - 1]
        on = self._areas.keeps(right, number, number), self._areas.keeps(left, number, number)
        states = possible(
            self._problem.covers,
            self._allowed(right, task, number, number) if on[0] else OFF_BIT,
            self._allowed(left, task, number, number) if on[1] else OFF_BIT,
        )
        return _Task(
            states,
            *on,
            on[0] and self._areas.keeps(right, number, number + 1),
            on[1] and self._areas.keeps(left, number, number + 1),
        )

    def regrasps(self, number: int) -> tuple[Onto, ...]:
        """Return the regrasps that are possible after a task."""
        found = (self._regrasp(hand, number) for hand in HANDS if self._areas.keeps(hand, number, number + 1))
        return tuple(onto for onto in found if onto is not None)

    def _regrasp(self, hand: Hand, number: int) -> Onto | None:
        procedure = self._problem.procedure
        helper = needs_helper(procedure, hand, number)
        if helper is None:
            return None
        task, other = regrasp_task(hand, procedure.tasks[number - 1].holder), HANDS[1 - HANDS.index(hand)]
        own = self._allowed(hand, task, number, number + 1)
        stays = helper or self._areas.keeps(other, number, number + 1)
        return Onto(hand == "r", own, self._allowed(other, task, number, number + 1) if stays else OFF_BIT, helper)


@dataclass(frozen=True, slots=True)
class HandoverSearch:
    """The moves found, fewest first of all; or None and the first task that no number of them leads into.

    `alone`: that task has no grasps even by itself.
    """

    moves: tuple[Move, ...] | None
    stuck_at: int | None
    alone: bool = False


class _Layers:
    """States reached with at most k regrasps, per task: in it, and after it once leaving hands are off the box."""

    def __init__(self, covers: Covers, areas: _Areas, tasks: Sequence[_Task]) -> None:
        self.covers = covers
        self.tasks = tasks
        self._areas = areas
        self._moves: dict[int, tuple[Onto, ...]] = {}
        self._left: list[States] = [NO_STATES] * len(tasks)
        self._moved: list[States] = [NO_STATES] * len(tasks)
        self.inside: list[list[States]] = []
        self.beyond: list[list[States]] = []

    def leave(self, number: int, states: States) -> States:
        """Return the states after a task (from 0), before any regrasp."""
        task = self.tasks[number]
        return left_box(states, not task.right_stays, not task.left_stays)

    def enter(self, number: int, states: States) -> States:
        """Return the states in a task, from those before it."""
        task = self.tasks[number]
        stayed = (self.tasks[number - 1].right_stays, self.tasks[number - 1].left_stays) if number else (False, False)
        states = arrived(states, task.right and not stayed[0], task.left and not stayed[1])
        return intersection(states, task.states)

    def moves(self, number: int) -> tuple[Onto, ...]:
        """Return the regrasps that are possible after a task (from 0); asked for only where the search comes."""
        if number not in self._moves:
            self._moves[number] = self._areas.regrasps(number + 1)
        return self._moves[number]

    def add(self) -> None:
        """Allow one more regrasp."""
        states: States = (*NO_STATES[:OFF], OFF_BIT)
        inside, beyond = list[States](), list[States]()
        for number in range(len(self.tasks)):
            if not self.beyond or (number and states != self.beyond[-1][number - 1]):
                entered = self.enter(number, states)
                self._left[number] = self.leave(number, entered)
            else:
                entered = self.inside[-1][number]
            inside.append(entered)
            states = union(self._left[number], self._moved_on(number))
            beyond.append(states)
        self.inside.append(inside)
        self.beyond.append(beyond)

    def _moved_on(self, number: int) -> States:
        """Return the states after one regrasp from those reached so far after a task (from 0)."""
        if not self.beyond:
            return NO_STATES
        states = self.beyond[-1][number]
        if len(self.beyond) == 1 or states != self.beyond[-2][number]:
            moved = NO_STATES
            if any(states):
                for onto in self.moves(number):
                    moved = union(moved, regrasped(states, self.covers, onto))
            self._moved[number] = moved
        return self._moved[number]

    def trace(self) -> tuple[Move, ...]:
        """Return the moves on a way to the last task."""
        moves: list[Move] = []
        level = len(self.inside) - 1
        state = _any(self.inside[level][-1])
        for number in range(len(self.tasks) - 2, -1, -1):
            task, (right, left) = self.tasks[number], state
            # A hand that came with the next task was off the box before it.
            state = (right if task.right_stays else OFF, left if task.left_stays else OFF)
            while not self.leave(number, self.inside[level][number])[state[0]] >> state[1] & 1:
                level -= 1
                state, hand = self._undone(level, number, state)
                moves.append((hand, number + 1))
            state = self._held(level, number, state)
        return tuple((hand, after + added) for added, (hand, after) in enumerate(reversed(moves)))

    def _undone(self, level: int, number: int, state: tuple[int, int]) -> tuple[tuple[int, int], Hand]:
        for onto in self.moves(number):
            found = before_regrasp(self.beyond[level][number], self.covers, onto, state)
            if found is not None:
                return found, "r" if onto.right else "l"
        raise AssertionError(f"state {state} after task {number + 1} has no way into it")

    def _held(self, level: int, number: int, state: tuple[int, int]) -> tuple[int, int]:
        task, states = self.tasks[number], self.inside[level][number]
        right = 1 << state[0] if task.right_stays else (1 << OFF + 1) - 1
        left = 1 << state[1] if task.left_stays else (1 << OFF + 1) - 1
        return _any(tuple(row & left if right >> r & 1 else 0 for r, row in enumerate(states)))


def _any(states: States) -> tuple[int, int]:
    row = next(r for r in range(OFF + 1) if states[r])
    return row, (states[row] & -states[row]).bit_length() - 1


def fewest_moves(problem: AreaProblem) -> HandoverSearch:
    """Return the fewest added regrasps with which both hands find components through the whole procedure.

    Exact and complete: regrasps are allowed one by one until the last task is reached or one more adds no state.
    Given areas are whole; compatibility is mutual, so the order of priorities cannot matter.

    Raises:
        ValueError: the procedure has an added regrasp already.
    """
    if any(task.regrasps is not None for task in problem.procedure.tasks):
        raise ValueError("the search for regrasps takes a procedure without added ones")
    areas, tasks = _Areas(problem), list[_Task]()
    for number, _ in problem.procedure.numbered():
        task = areas.task(number)
        if not any(task.states):
            return HandoverSearch(None, number, alone=True)
        tasks.append(task)
    layers = _Layers(problem.covers, areas, tasks)
    while True:
        layers.add()
        if any(layers.inside[-1][-1]):
            return HandoverSearch(layers.trace(), None)
        if len(layers.beyond) > 1 and layers.beyond[-1] == layers.beyond[-2]:
            stuck = next(n for n, states in enumerate(layers.inside[-1], start=1) if not any(states))
            return HandoverSearch(None, stuck)
