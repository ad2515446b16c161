"""The one move that changes a procedure: an added task in which a hand lets go of the box and grasps it anew."""

from __future__ import annotations

from dataclasses import replace

from preshape.planner.procedure import HANDS, Block, Hand, Procedure, Task


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
    other = HANDS[1 - HANDS.index(hand)]
    spanning = [b for b in procedure.blocks if b.first <= after < b.last]
    own = next((b for b in spanning if b.resource == hand), None)
    others = next((b for b in spanning if b.resource == other), None)
    if own is None or own.want != "grasp":
        return None
    if procedure.tasks[after - 1].holder != hand:
        return False
    if others is None:
        return True
    return False if others.want == "grasp" else None


def with_regrasp(procedure: Procedure, hand: Hand, after: int) -> Procedure:
    """Return the procedure with a regrasp of `hand` added after task number `after`.

    Blocks that run over the cut keep their area through the added task. The hand's own block ends in it and a new
    one begins in it. A helping hand has a block of that task alone: the box goes over to it and comes back.

    Raises:
        ValueError: where `needs_helper` is None.
    """
    helper = needs_helper(procedure, hand, after)
    if helper is None:
        raise ValueError(f"no regrasp of {hand} after task {after}: it keeps no grasp that the other could relieve")
    added = after + 1
    blocks: list[Block] = []
    for block in procedure.blocks:
        moved = replace(block, first=block.first + (block.first > after), last=block.last + (block.last > after))
        if block.resource == hand and block.covers(after, added):
            blocks += [replace(moved, last=added), replace(moved, first=added)]
        else:
            blocks.append(moved)
    if helper:
        blocks.append(Block(HANDS[1 - HANDS.index(hand)], added, added))
    task = regrasp_task(hand, procedure.tasks[after - 1].holder)
    return Procedure((*procedure.tasks[:after], task, *procedure.tasks[after:]), tuple(blocks))
