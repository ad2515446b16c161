"""When an area is empty: other priorities, or added regrasps, as few as possible; else the cause (section III-B)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from preshape.hal.world import NominalBox, Opening
from preshape.planner.area_problem import AreaProblem, Usable
from preshape.planner.areas import Reading
from preshape.planner.certificate import Certificate
from preshape.planner.committed_domains import committed_certificate, given_clash
from preshape.planner.component import surviving
from preshape.planner.handover_path import fewest_moves
from preshape.planner.literal_regions import literal_certificate, literal_masks
from preshape.planner.literal_search import fewest_literal_moves, literal_order
from preshape.planner.priorities import default_order, derive_priorities, priorities_in_order
from preshape.planner.procedure import Block, Procedure
from preshape.planner.regrasp_move import with_regrasps
from preshape.planner.sections import split

LITERAL_LIMIT = 2
"""Most regrasps that are added in the literal reading."""


@dataclass(frozen=True, slots=True, eq=False)
class RegraspPlan:
    """A procedure that has areas for all, for `plan_areas` with these priorities; or the reason why none exists.

    `regrasps` is how many were added; `reordered` whether the priorities are other than derived. With a
    certificate, the procedure and priorities are those given.
    """

    procedure: Procedure
    priorities: dict[Block, int]
    regrasps: int
    reordered: bool
    certificate: Certificate | None


def fewest_regrasps(
    procedure: Procedure,
    box: NominalBox,
    opening: Opening | None = None,
    reading: Reading = "committed",
    palm_on_end_caps_only: bool = False,
    usable: Usable | None = None,
    limit: int = LITERAL_LIMIT,
) -> RegraspPlan:
    """Return the procedure with the fewest added regrasps in which every grasp has a component.

    Among procedures with as many regrasps, derived priorities come before changed ones. `committed` finds the
    fewest of any number; `literal` tries all orders of priorities and all ways to add up to `limit` regrasps.
    `usable` is asked about added tasks, too (see `regrasp_task`).

    Raises:
        ValueError: as `plan_areas`; a procedure that has an added regrasp already.
    """
    problem = AreaProblem(procedure, split(box, opening), opening, palm_on_end_caps_only, usable)
    if any(task.regrasps is not None for task in procedure.tasks):
        raise ValueError("the search for regrasps takes a procedure without added ones")
    clash = given_clash(problem, procedure.blocks)
    if clash is not None:
        higher, lower = sorted(clash, key=default_order(procedure).index)
        certificate = Certificate(lower, (higher,), scope="given areas; no order and no regrasp changes them")
        return RegraspPlan(procedure, derive_priorities(procedure), 0, False, certificate)
    return _literal(problem, limit) if reading == "literal" else _committed(problem)


def _committed(problem: AreaProblem) -> RegraspPlan:
    procedure = problem.procedure
    found = fewest_moves(problem)
    if found.moves is not None:
        changed = with_regrasps(procedure, *found.moves)
        return RegraspPlan(changed, derive_priorities(changed), len(found.moves), False, None)
    if found.alone and found.stuck_at is not None:
        certificate = _single_task_cause(problem, found.stuck_at)
    else:
        scope = f"no order and no number of added regrasps leads into task {found.stuck_at}"
        certificate = replace(committed_certificate(problem, default_order(procedure)), scope=scope)
    return RegraspPlan(procedure, derive_priorities(procedure), 0, False, certificate)


def _single_task_cause(problem: AreaProblem, number: int) -> Certificate:
    """Return why a task has no grasps even by itself: then no added task can help."""
    blocks = {replace(b, first=1, last=1): b for b in problem.procedure.blocks if b.covers(number)}
    alone = replace(problem, procedure=Procedure((problem.procedure.tasks[number - 1],), tuple(blocks)))
    cause = committed_certificate(alone, default_order(alone.procedure))
    return replace(
        cause,
        block=blocks[cause.block],
        constraints=tuple(blocks[b] for b in cause.constraints),
        scope=f"in task {number} alone; no order and no number of added regrasps helps",
    )


def _literal(problem: AreaProblem, limit: int) -> RegraspPlan:
    procedure = problem.procedure
    moves = fewest_literal_moves(problem, limit)
    if moves is None:
        priorities = derive_priorities(procedure)
        cause = _literal_cause(problem, tuple(sorted(procedure.blocks, key=priorities.__getitem__)))
        cause = replace(cause, scope=f"no other order and up to {limit} added regrasps do not help")
        return RegraspPlan(procedure, priorities, 0, False, cause)
    procedure = with_regrasps(procedure, *moves)
    changed = replace(problem, procedure=procedure)
    order = default_order(procedure)
    if all(_left(changed, block, mask) for block, mask in literal_masks(changed, order).items()):
        return RegraspPlan(procedure, derive_priorities(procedure), len(moves), False, None)
    order = literal_order(changed)
    if order is None:
        raise AssertionError(f"{len(moves)} regrasps were found for an order that does not exist")
    return RegraspPlan(procedure, priorities_in_order(procedure, order), len(moves), True, None)


def _literal_cause(problem: AreaProblem, order: tuple[Block, ...]) -> Certificate:
    masks = literal_masks(problem, order)
    failed = next(b for b in order if not _left(problem, b, masks[b]))
    return literal_certificate(problem, order, masks, failed)


def _left(problem: AreaProblem, block: Block, mask: int) -> bool:
    if block.want != "grasp":
        return mask == problem.wanted(block)
    return problem.allowed_in(block, surviving(mask)) != 0
