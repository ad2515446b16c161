"""Laws of the priorities: the paper's procedure gives eq. (3), every procedure keeps the rule."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.planner.priorities import (
    base_priority,
    checked_order,
    default_order,
    derive_priorities,
    placing_order,
    priorities_in_order,
    priority_table,
)
from preshape.planner.procedure import PAPER_PROCEDURE, Block, Procedure, Task
from preshape.planner.regrasp_move import needs_helper, with_regrasps
from preshape.tools.random_procedure import random_procedure


def procedures(count: int = 300) -> list[Procedure]:
    rng = np.random.default_rng(3)
    return [random_procedure(rng, 7) for _ in range(count)]


def test_papers_procedure_gives_equation_3() -> None:
    table = priority_table(PAPER_PROCEDURE, derive_priorities(PAPER_PROCEDURE))
    assert table == {"r": [2, 2, 2, 1, 1], "l": [None, None, 3, 3, 3], "c": [None, 1, None, None, None]}


def test_papers_blocks_are_equation_1() -> None:
    grasps = [(b.resource, b.first, b.last) for b in PAPER_PROCEDURE.blocks if b.want == "grasp"]
    assert grasps == [("r", 1, 3), ("l", 3, 5)]
    assert [task.tau for task in PAPER_PROCEDURE.tasks] == [1, 1, 2, 1, 1]
    assert [task.main for task in PAPER_PROCEDURE.tasks] == ["none", "c", "none", "r", "r"]


def test_resources_of_one_task_have_different_priorities() -> None:
    for procedure in procedures():
        table = priority_table(procedure, derive_priorities(procedure))
        for column in zip(*table.values(), strict=True):
            used = [p for p in column if p is not None]
            assert len(used) == len(set(used))


def test_each_block_has_the_smallest_priority_that_earlier_blocks_leave() -> None:
    for procedure in procedures():
        priorities, order = derive_priorities(procedure), placing_order(procedure)
        for k, block in enumerate(order):
            base = base_priority(procedure, block)
            taken = {priorities[other] for other in order[:k] if block.meets(other)}
            free = [p for p in range(base, base + len(order) + 1) if p not in taken]
            assert priorities[block] == free[0]


def test_default_order_goes_down_the_priorities() -> None:
    filled = 0
    for procedure in procedures():
        priorities, order = derive_priorities(procedure), default_order(procedure)
        for k, block in enumerate(order):
            assert all(priorities[other] < priorities[block] for other in order[:k] if block.meets(other))
        filled += order != placing_order(procedure)
    assert filled > 0


def test_main_resource_has_base_priority_1_and_others_the_largest_tau() -> None:
    for procedure in procedures():
        for block in procedure.blocks:
            tasks = procedure.tasks[block.first - 1 : block.last]
            main = any(task.main == block.resource for task in tasks)
            assert base_priority(procedure, block) == (1 if main else max(task.tau for task in tasks))


def test_priorities_do_not_depend_on_the_order_in_which_blocks_are_listed() -> None:
    rng = np.random.default_rng(5)
    for procedure in procedures():
        blocks = tuple(procedure.blocks[k] for k in rng.permutation(len(procedure.blocks)))
        assert derive_priorities(Procedure(procedure.tasks, blocks)) == derive_priorities(procedure)


def test_priorities_in_any_order_put_that_order_first() -> None:
    rng = np.random.default_rng(6)
    for procedure in procedures():
        order = [procedure.blocks[k] for k in rng.permutation(len(procedure.blocks))]
        priorities = priorities_in_order(procedure, order)
        for k, block in enumerate(order):
            assert all(priorities[other] < priorities[block] for other in order[:k] if block.meets(other))


def test_equal_priorities_in_one_task_are_refused() -> None:
    priorities = dict.fromkeys(PAPER_PROCEDURE.blocks, 1)
    with pytest.raises(ValueError, match="share a task"):
        checked_order(PAPER_PROCEDURE, priorities)
    with pytest.raises(ValueError, match="none given"):
        checked_order(PAPER_PROCEDURE, {})


@pytest.mark.parametrize(
    ("tasks", "blocks", "message"),
    [
        ((), (), "tasks is empty"),
        ((Task("a", 1, "c"),), (), "main resource c has no area"),
        ((Task("a", 1, "none", "r"),), (), "holder r has no grasp"),
        ((Task("a"),), (Block("r", 1, 2),), "only 1 tasks"),
        ((Task("a"), Task("b")), (Block("r", 1, 2), Block("r", 2, 2)), "overlap in task 2"),
        (
            (Task("a", 1, "none", "r"), Task("b", 1, "none", "l")),
            (Block("r", 1, 1), Block("l", 2, 2)),
            "does not keep its grasp",
        ),
    ],
)
def test_procedure_that_makes_no_sense_is_refused(
    tasks: tuple[Task, ...], blocks: tuple[Block, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Procedure(tasks, blocks)


def test_added_regrasp_keeps_all_other_areas_and_ends_the_hands_own_in_it() -> None:
    added = 0
    for procedure in procedures(100):
        for after in range(1, len(procedure.tasks)):
            for hand in ("r", "l"):
                helper = needs_helper(procedure, hand, after)
                if helper is None:
                    with pytest.raises(ValueError, match="no regrasp"):
                        with_regrasps(procedure, (hand, after))
                    continue
                added += 1
                changed = with_regrasps(procedure, (hand, after))
                assert len(changed.tasks) == len(procedure.tasks) + 1
                assert len(changed.blocks) == len(procedure.blocks) + 1 + helper
                assert sum(b.resource == hand and b.covers(after + 1) for b in changed.blocks) == 2
                kept = [t for t in changed.tasks if t.regrasps is None]
                assert tuple(kept) == procedure.tasks
    assert added > 50
