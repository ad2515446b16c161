"""Which components each grasp can still have when both hands commit to one each (the committed reading)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from preshape.planner.area_problem import AreaProblem
from preshape.planner.certificate import Certificate
from preshape.planner.procedure import Block

Domains = dict[Block, int]
"""Grasp block -> its components, as bits."""


@dataclass(frozen=True, slots=True, eq=False)
class Meetings:
    """The grasp blocks and the pairs of them that share a task.

    The pairs form a forest, since each hand has one block at a time; on a forest pairwise consistency is enough
    for a joint choice.
    """

    blocks: tuple[Block, ...]
    pairs: tuple[tuple[Block, Block], ...]

    @staticmethod
    def of(blocks: Collection[Block]) -> Meetings:
        """Return the meetings among these blocks."""
        grasps = tuple(b for b in blocks if b.want == "grasp")
        pairs = tuple((a, b) for k, a in enumerate(grasps) for b in grasps[k + 1 :] if a.meets(b))
        return Meetings(grasps, pairs)


def propagate(problem: AreaProblem, meetings: Meetings, domains: Domains) -> bool:
    """Shrink domains in place until every component has a partner in each block met; False if a domain empties."""
    covers = problem.covers
    changed = True
    while changed:
        changed = False
        for a, b in meetings.pairs:
            kept_a = domains[a] & covers.supported(domains[b])
            kept_b = domains[b] & covers.supported(kept_a)
            changed = changed or kept_a != domains[a] or kept_b != domains[b]
            domains[a], domains[b] = kept_a, kept_b
    return all(domains.values())


def given_clash(problem: AreaProblem, blocks: Collection[Block]) -> tuple[Block, Block] | None:
    """Return two given areas of one task that overlap, if there are any: neither can be whole then."""
    given = [b for b in blocks if b.want != "grasp"]
    for k, a in enumerate(given):
        for b in given[k + 1 :]:
            if a.meets(b) and problem.wanted(a) & problem.wanted(b):
                return a, b
    return None


def start_domains(problem: AreaProblem, blocks: Collection[Block]) -> Domains:
    """Return the components of each grasp block that keep out of all given areas met and that its hand may use."""
    given = tuple(b for b in blocks if b.want != "grasp")
    return {b: problem.allowed_in(b, problem.free_of_given(b, given)) for b in blocks if b.want == "grasp"}


def holds(problem: AreaProblem, blocks: Collection[Block]) -> bool:
    """Return whether these blocks, and no others, can have their areas together."""
    if given_clash(problem, blocks) is not None:
        return False
    return propagate(problem, Meetings.of(blocks), start_domains(problem, blocks))


def committed_certificate(problem: AreaProblem, order: tuple[Block, ...]) -> Certificate:
    """Return an irreducible cause of a problem whose blocks do not hold together; `order` as in the priorities.

    Restrictions are dropped first, then grasps, then given areas, each as long as the rest still fails.
    """
    clash = given_clash(problem, order)
    if clash is not None:
        higher, lower = sorted(clash, key=order.index)
        return Certificate(lower, (higher,))
    kept = list(order)
    if problem.usable is not None:
        without_usable = replace(problem, usable=None)
        problem = problem if holds(without_usable, order) else without_usable
    if problem.palm_on_end_caps_only:
        any_palm = replace(problem, palm_on_end_caps_only=False)
        problem = problem if holds(any_palm, order) else any_palm
    for block in sorted(order, key=lambda b: b.want != "grasp"):
        rest = [b for b in kept if b != block]
        if not holds(problem, rest):
            kept = rest
    emptied = next(b for b in reversed(kept) if b.want == "grasp")
    others = tuple(b for b in kept if b != emptied)
    return Certificate(emptied, others, problem.palm_on_end_caps_only, problem.usable is not None)
