"""The fewest added regrasps in the committed reading: shortest path over what both hands hold, task by task."""

from __future__ import annotations

from dataclasses import dataclass

from preshape.planner.area_problem import AreaProblem
from preshape.planner.hold_states import (
    NO_STATES,
    OFF,
    OFF_BIT,
    Onto,
    States,
    arrived,
    before_regrasp,
    left_box,
    regrasped,
    union,
    within,
)
from preshape.planner.procedure import HANDS, Block, Hand
from preshape.planner.regrasp_move import needs_helper, regrasp_task

Move = tuple[Hand, int]
"""A regrasp of a hand after a task of the procedure that is searched, numbered as before any was added."""


@dataclass(frozen=True, slots=True)
class _Task:
    """Components allowed in a task, OFF among them where the hand is not on the box; who stays; possible regrasps."""

    right: int
    left: int
    right_stays: bool
    left_stays: bool
    moves: tuple[Onto, ...]


def _grasp(problem: AreaProblem, hand: Hand, *numbers: int) -> Block | None:
    blocks = problem.procedure.blocks
    return next((b for b in blocks if b.resource == hand and b.want == "grasp" and b.covers(*numbers)), None)


def _allowed(problem: AreaProblem, hand: Hand, number: int) -> int:
    if _grasp(problem, hand, number) is None:
        return OFF_BIT
    given = tuple(b for b in problem.procedure.blocks if b.want != "grasp" and b.covers(number))
    task = problem.procedure.tasks[number - 1]
    return problem.allowed(hand, task, among=problem.free_of_given(Block(hand, number, number), given))


def _onto(problem: AreaProblem, hand: Hand, number: int) -> Onto | None:
    helper = needs_helper(problem.procedure, hand, number)
    if helper is None:
        return None
    task = regrasp_task(hand, problem.procedure.tasks[number - 1].holder)
    given = tuple(b for b in problem.procedure.blocks if b.want != "grasp" and b.covers(number, number + 1))
    other = HANDS[1 - HANDS.index(hand)]

    def free(who: Hand) -> int:
        return problem.allowed(who, task, among=problem.free_of_given(Block(who, number, number), given))

    stays = helper or _grasp(problem, other, number, number + 1) is not None
    return Onto(hand == "r", free(hand), free(other) if stays else OFF_BIT, helper)


def _tasks(problem: AreaProblem) -> list[_Task]:
    tasks: list[_Task] = []
    for number, _ in problem.procedure.numbered():
        right, left = (_allowed(problem, hand, number) for hand in HANDS)
        stays = [_grasp(problem, hand, number, number + 1) is not None for hand in HANDS]
        moves = [_onto(problem, hand, number) for hand in HANDS]
        tasks.append(_Task(right, left, stays[0], stays[1], tuple(m for m in moves if m is not None)))
    return tasks


@dataclass(frozen=True, slots=True)
class HandoverSearch:
    """The moves found, fewest first of all; or None and the first task that no number of them leads into."""

    moves: tuple[Move, ...] | None
    stuck_at: int | None


class _Layers:
    """States reached with at most k regrasps, per task: in it, and after it once leaving hands are off the box."""

    def __init__(self, problem: AreaProblem) -> None:
        self.covers = problem.covers
        self.tasks = _tasks(problem)
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
        states = arrived(states, task.right != OFF_BIT and not stayed[0], task.left != OFF_BIT and not stayed[1])
        return within(states, self.covers, task.right, task.left)

    def add(self) -> None:
        """Allow one more regrasp."""
        states: States = (*NO_STATES[:OFF], OFF_BIT)
        inside, beyond = list[States](), list[States]()
        fewer = self.beyond[-1] if self.beyond else None
        for number, task in enumerate(self.tasks):
            inside.append(self.enter(number, states))
            states = self.leave(number, inside[-1])
            if fewer is not None:
                for onto in task.moves:
                    states = union(states, regrasped(fewer[number], self.covers, onto))
            beyond.append(states)
        self.inside.append(inside)
        self.beyond.append(beyond)

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
        return tuple(reversed(moves))

    def _undone(self, level: int, number: int, state: tuple[int, int]) -> tuple[tuple[int, int], Hand]:
        for onto in self.tasks[number].moves:
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
    layers = _Layers(problem)
    while True:
        layers.add()
        if any(layers.inside[-1][-1]):
            return HandoverSearch(layers.trace(), None)
        if len(layers.beyond) > 1 and layers.beyond[-1] == layers.beyond[-2]:
            stuck = next(n for n, states in enumerate(layers.inside[-1], start=1) if not any(states))
            return HandoverSearch(None, stuck)
