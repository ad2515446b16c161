"""The literal reading of section III-B: whole areas of higher priority are subtracted, whatever is done with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from preshape.planner.area_problem import AreaProblem
from preshape.planner.certificate import Certificate
from preshape.planner.component import surviving
from preshape.planner.procedure import Block
from preshape.planner.region import WHOLE


def literal_masks(problem: AreaProblem, order: tuple[Block, ...]) -> dict[Block, int]:
    """Return every block's region in the literal reading, as bits: G_b = G_wanted & ~(union of higher G)."""
    masks: dict[Block, int] = {}
    for block in order:
        mask = problem.wanted(block)
        for other, taken in masks.items():
            if block.meets(other):
                mask &= ~taken
        masks[block] = mask
    return masks


def literal_certificate(
    problem: AreaProblem, order: tuple[Block, ...], masks: Mapping[Block, int], block: Block
) -> Certificate:
    """Return an irreducible cause of a block's failure in an order; restrictions are dropped before areas."""
    higher = [b for b in order[: order.index(block)] if b.meets(block)]
    if block.want != "grasp":
        return Certificate(block, (next(b for b in higher if masks[b] & problem.wanted(block)),))

    def empty(restrictions: AreaProblem, blocks: list[Block]) -> bool:
        taken = 0
        for other in blocks:
            taken |= masks[other]
        return not restrictions.allowed_in(block, surviving(WHOLE & ~taken))

    without_usable = replace(problem, usable=None)
    problem = without_usable if empty(without_usable, higher) else problem
    any_palm = replace(problem, palm_on_end_caps_only=False)
    problem = any_palm if empty(any_palm, higher) else problem
    kept = list(higher)
    for other in higher:
        rest = [b for b in kept if b != other]
        kept = rest if empty(problem, rest) else kept
    return Certificate(block, tuple(kept), problem.palm_on_end_caps_only, problem.usable is not None)
