"""Priorities of areas from priorities of tasks: eq. (2) and (3) of section III-B by one rule."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from preshape.planner.procedure import RESOURCES, Block, Procedure, Resource

Priorities = Mapping[Block, int]
"""Block -> its priority p; 1 goes first. One number per block, which is eq. (2)."""


def base_priority(procedure: Procedure, block: Block) -> int:
    """Return 1 if the block's resource is main in any of its tasks, else the largest tau over them."""
    tasks, resource = procedure.tasks[block.first - 1 : block.last], block.resource
    return 1 if resource in [task.main for task in tasks] else max([task.tau for task in tasks])


def placing_order(procedure: Procedure) -> tuple[Block, ...]:
    """Return the blocks as priorities are given to them: by (base priority, first task, r < l < c)."""
    return tuple(
        sorted(
            procedure.blocks,
            key=lambda b: (base_priority(procedure, b), b.first, RESOURCES.index(b.resource)),
        )
    )


def derive_priorities(procedure: Procedure) -> dict[Block, int]:
    """Return every block's priority: the smallest integer >= base that no placed block of a shared task has.

    Blocks are placed in `placing_order`. For the paper's procedure this is eq. (3).
    """
    placed: list[tuple[Block, int]] = []
    for block in placing_order(procedure):
        taken = [priority for other, priority in placed if block.meets(other)]
        priority = base_priority(procedure, block)
        while priority in taken:
            priority += 1
        placed.append((block, priority))
    return dict(placed)


def priorities_in_order(procedure: Procedure, order: Iterable[Block]) -> dict[Block, int]:
    """Return priorities that put competing blocks in this order: each above all placed ones of a shared task."""
    placed: dict[Block, int] = {}
    for block in order:
        placed[block] = 1 + max((placed[other] for other in procedure.meeting(block) if other in placed), default=0)
    return placed


def checked_order(procedure: Procedure, priorities: Priorities) -> tuple[Block, ...]:
    """Return the blocks from the highest priority down.

    Raises:
        ValueError: when a block has no priority, or two blocks that share a task have the same one.
    """
    for block in procedure.blocks:
        if block not in priorities:
            raise ValueError(f"priorities: none given for {block}")
        for other in procedure.meeting(block):
            if priorities.get(other) == priorities[block]:
                raise ValueError(f"priorities: {block} and {other} share a task and both have {priorities[block]}")
    return tuple(sorted(procedure.blocks, key=lambda b: priorities[b]))


def default_order(procedure: Procedure) -> tuple[Block, ...]:
    """Return the blocks from the highest derived priority down.

    Not always the order in which they were placed: a block placed late may fill a gap above an earlier one.
    """
    numbers = derive_priorities(procedure)
    return tuple(sorted(procedure.blocks, key=numbers.__getitem__))


def priority_table(procedure: Procedure, priorities: Priorities) -> dict[Resource, list[int | None]]:
    """Return p_ri, p_li, p_ci over the tasks as in eq. (3); None is the paper's * (resource not used)."""
    table: dict[Resource, list[int | None]] = {}
    for resource in RESOURCES:
        blocks = [procedure.at(resource, number) for number, _ in procedure.numbered()]
        table[resource] = [None if block is None else priorities[block] for block in blocks]
    return table
