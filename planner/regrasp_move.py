"""The one move that changes a procedure: an added task in which a hand lets go of the box and grasps it anew."""

from __future__ import annotations

from collections.abc import Sequence

from preshape.planner.procedure import HANDS, Block, Hand, Procedure, Task

Move = tuple[Hand, int]
"""A regrasp of a hand after a task; tasks are counted as they are when it is added."""


def regrasp_task(hand: Hand, holder: Hand | None) -> Task:
    """Return the added task: planned (tau 2), nobody's main task, named "regrasp r" or "regrasp l".

    A box that a hand holds is passed on in the air, one that rests is grasped anew where it is.
    """
    return Task(f"regrasp {hand}", 2, "none", holder, hand, "here" if holder is None else "passed on")


def needs_helper(procedure: Procedure, hand: Hand, after: int) -> bool | None:
    """Return whether the other hand must take the box for a regrasp after task `after`; None if it cannot be.

    None: `hand` keeps no grasp from that task into the next, or it alone holds the box while the other works. No
    helper is needed while the box rests or the other hand keeps its own grasp over both tasks.
    """
    return _helper(procedure.tasks, procedure.blocks, hand, after)


def with_regrasps(procedure: Procedure, *moves: Move) -> Procedure:
    """Return the procedure with these regrasps added, one after the other.

    Blocks that run over the cut keep their area through the added task. The hand's own block ends in it and a new
    one begins in it. A helping hand has a block of that task alone: the box goes over to it and comes back.

    Raises:
        ValueError: where `needs_helper` is None.
    """
    tasks, blocks = list(procedure.tasks), list(procedure.blocks)
    for hand, after in moves:
        helper = _helper(tasks, blocks, hand, after)
        if helper is None:
            raise ValueError(f"no regrasp of {hand} after task {after}: it keeps no grasp that the other could relieve")
        added, moved = after + 1, list[Block]()
        for block in blocks:
            if block.last <= after:
                moved.append(block)
            elif block.first > after:
                moved.append(Block(block.resource, block.first + 1, block.last + 1, block.want))
            elif block.resource == hand:
                moved += (Block(hand, block.first, added), Block(hand, added, block.last + 1))
            else:
                moved.append(Block(block.resource, block.first, block.last + 1, block.want))
        if helper:
            moved.append(Block(HANDS[1 - HANDS.index(hand)], added, added))
        blocks = moved
        tasks.insert(after, regrasp_task(hand, tasks[after - 1].holder))
    return Procedure(tuple(tasks), tuple(blocks))


def _helper(tasks: Sequence[Task], blocks: Sequence[Block], hand: Hand, after: int) -> bool | None:
    own, others = None, None
    for block in blocks:
        if block.first <= after < block.last:
            if block.resource == hand:
                own = block
            elif block.resource in HANDS:
                others = block
    if own is None or own.want != "grasp":
        return None
    if tasks[after - 1].holder != hand:
        return False
    if others is None:
        return True
    return False if others.want == "grasp" else None
