"""The fewest added regrasps in the literal reading: all ways to add them, each with all orders of priorities.

Grasps hang together where they share tasks. What hangs together is searched by itself: a regrasp changes nothing
for the rest, so the fewest of all are the fewest of each.
"""

from __future__ import annotations

from preshape.planner.area_problem import AreaProblem
from preshape.planner.component import surviving
from preshape.planner.literal_group import NO_GRASP, GraspGroup, grasp_groups
from preshape.planner.literal_order import GraspForest, GraspSpan, Subtrees
from preshape.planner.procedure import Block, Procedure
from preshape.planner.region import WHOLE
from preshape.planner.regrasp_move import Move
from preshape.planner.task_areas import Limits


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
            GraspSpan(block.first, block.last, ("r", "l").index(block.resource), free, problem.allowed_in(block))
        )
    order = GraspForest(tuple(spans)).order()
    given = (b for b in problem.procedure.blocks if b.want != "grasp")
    return None if order is None else (*given, *(grasps[k] for k in order))


def fewest_literal_moves(problem: AreaProblem, limit: int) -> tuple[Move, ...] | None:
    """Return the fewest regrasps, at most `limit`, with which some order leaves every grasp a component; else None."""
    groups = grasp_groups(problem)
    if not all(_each_alone(group) for group in groups):
        return None
    failing = [group for group in groups if not GraspForest(group.spans).complete()]
    spare = limit - len(failing)
    if spare < 0 or any(group.shares and not _can_share(group) for group in failing):
        return None
    moves: tuple[Move, ...] = ()
    # From the last to the first: an added task renumbers later ones only.
    for group in reversed(failing):
        found = _fewest(group, 1 + spare)
        if found is None:
            return None
        spare -= len(found) - 1
        moves += found
    return moves


def _fewest(group: GraspGroup, limit: int) -> tuple[Move, ...] | None:
    """Return the fewest regrasps, 1 to `limit`, for a group that has no order without."""
    groups, can_share, subtrees = [group], _can_share(group), Subtrees()
    for _ in range(limit):
        groups = [g for shorter in groups for g in shorter.longer() if can_share or not g.shares]
        for g in groups:
            if GraspForest(g.spans, subtrees).complete():
                return g.moves
    return None


def _each_alone(group: GraspGroup) -> bool:
    """Return False if a grasp has no component in one of its tasks even beside the given areas alone."""
    return all(group.tasks[n - 1][s.hand][1] for s in group.spans for n in range(s.first, s.last + 1))


def _can_share(group: GraspGroup) -> bool:
    """Return False if no two hands can be on the box in one task, however many regrasps are added.

    Of the grasps that meet others, one has no higher one among them. Its region is all but the areas given in its
    tasks, so whatever meets it must have a component within those given areas, in each task that both share.
    """
    places = [(hand, cut) for cuts in group.cuts for hand, cut in enumerate(cuts) if cut is not None]
    return (
        any(_can_lead(group, span) for span in group.spans)
        or any(_fits(cut.limits[1 - hand], _reserved(cut.limits[hand])) for hand, cut in places)
        or any(_fits(cut.limits[hand], _reserved(cut.limits[1 - hand])) for hand, cut in places if cut.helper)
    )


def _can_lead(group: GraspGroup, span: GraspSpan) -> bool:
    """Return False if neither a grasp nor what regrasps leave of it in some tasks can be the highest that it meets."""
    own, other = span.hand, 1 - span.hand
    for first in range(span.first, span.last + 1):
        before = group.cuts[first - 2][own] if first > span.first else None
        if first > span.first and before is None:
            continue
        reserved, shared = 0, list[Limits]()
        for last in range(first, span.last + 1):
            limits = group.tasks[last - 1]
            reserved |= _reserved(limits[own])
            shared += [limits[other]] if limits[other] != NO_GRASP else []
            behind = group.cuts[last - 1][own] if last < span.last else None
            if last < span.last and behind is None:
                continue
            helpers = [cut.limits[other] for cut in (before, behind) if cut is not None and cut.helper]
            fits = all(_fits(met, reserved) for met in shared)
            if fits and (shared or any(_fits(met, reserved) for met in helpers)):
                return True
    return False


def _reserved(limits: Limits) -> int:
    return WHOLE & ~limits[0]


def _fits(limits: Limits, region: int) -> bool:
    return surviving(region & limits[0]) & limits[1] != 0
