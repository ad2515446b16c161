"""Areas of all hands and of the camera, from the highest priority down (section III-B)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from preshape.hal.world import NominalBox, Opening
from preshape.planner.area_problem import AreaProblem, Usable
from preshape.planner.certificate import Certificate
from preshape.planner.committed_domains import (
    Meetings,
    committed_certificate,
    given_clash,
    propagate,
    start_domains,
)
from preshape.planner.component import EVERY, Component, all_components, on_end_caps, selected, surviving
from preshape.planner.literal_regions import literal_certificate, literal_masks
from preshape.planner.priorities import Priorities, checked_order, derive_priorities
from preshape.planner.procedure import Block, Procedure, Resource
from preshape.planner.region import Region
from preshape.planner.sections import Sections, split

Reading = Literal["literal", "committed"]
Choose = Callable[[Block, tuple[Component, ...]], Component]
"""Picks one of the candidates of a grasp block, which are never empty."""


@dataclass(frozen=True, slots=True)
class BlockArea:
    """The area of one block.

    Attributes:
        block: whose area it is.
        priority: its p of eq. (3).
        region: G, all patches left to it.
        components: the components whose three patches lie in `region`; none for a given area.
        candidates: those among them that the hand can use and, in the committed reading, that leave every other
            grasp of the procedure a choice.
        chosen: the one picked, None for a given area or when there is no plan.
    """

    block: Block
    priority: int
    region: Region
    components: tuple[Component, ...] = ()
    candidates: tuple[Component, ...] = ()
    chosen: Component | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Areas:
    """All areas, in the order of the procedure's blocks; `certificate` says why there is no plan, if there is none."""

    procedure: Procedure
    sections: Sections
    reading: Reading
    blocks: tuple[BlockArea, ...]
    certificate: Certificate | None

    @property
    def feasible(self) -> bool:
        """Whether every grasp has a component and every given area is whole."""
        return self.certificate is None

    @property
    def priorities(self) -> dict[Block, int]:
        """Priority of every block."""
        return {area.block: area.priority for area in self.blocks}

    def at(self, resource: Resource, task: int) -> BlockArea | None:
        """Return the area of a resource in a task (from 1), None where it is not used."""
        block = self.procedure.at(resource, task)
        return next((area for area in self.blocks if area.block == block), None)


def first_candidate(block: Block, candidates: tuple[Component, ...]) -> Component:
    """Return the first candidate; those with the palm on an end cap come first."""
    del block
    return candidates[0]


def plan_areas(
    procedure: Procedure,
    box: NominalBox,
    opening: Opening | None = None,
    reading: Reading = "committed",
    palm_on_end_caps_only: bool = False,
    choose: Choose = first_candidate,
    usable: Usable | None = None,
    priorities: Priorities | None = None,
) -> Areas:
    """Return the area of every block: G = G_wanted minus the union of all areas of higher priority in its tasks.

    `literal` subtracts whole areas, as section III-B prints it. `committed` subtracts from a hand what the other
    one has chosen and sweeps (`hand_covers`); each choice leaves all later ones a component.

    Args:
        procedure: tasks and blocks.
        box: nominal box; its candidate faces must lie along its longest edge.
        opening: None while it is unknown: every candidate face's middle patch then counts as the opening.
        reading: see above.
        palm_on_end_caps_only: leaves only components with the palm on an end cap.
        choose: picks one of a grasp's candidates.
        usable: which components a hand can use in a task; all if None.
        priorities: other than the derived ones.

    Raises:
        ValueError: a box, opening or priorities that make no sense; a choice that is no candidate.
    """
    problem = AreaProblem(procedure, split(box, opening), opening, palm_on_end_caps_only, usable)
    numbers = derive_priorities(procedure) if priorities is None else priorities
    order = checked_order(procedure, numbers)
    planner = _literal if reading == "literal" else _committed
    areas, certificate = planner(problem, order, numbers, choose)
    return Areas(procedure, problem.sections, reading, tuple(areas[b] for b in procedure.blocks), certificate)


def _area(
    problem: AreaProblem, block: Block, priority: int, mask: int, candidates: int, chosen: Component | None
) -> BlockArea:
    axis = problem.sections.long_axis
    found = 0
    if block.want == "grasp":
        found = surviving(mask) & (on_end_caps() if problem.palm_on_end_caps_only else EVERY)
    return BlockArea(
        block,
        priority,
        Region(axis, mask),
        selected(axis, found),
        selected(axis, found & candidates),
        chosen,
    )


def _picked(problem: AreaProblem, block: Block, candidates: int, choose: Choose) -> Component:
    offered = selected(problem.sections.long_axis, candidates)
    chosen = choose(block, offered)
    if chosen not in offered:
        raise ValueError(f"choice for {block}: {chosen} is none of its {len(offered)} candidates")
    return chosen


_Result = tuple[Mapping[Block, BlockArea], Certificate | None]


def _literal(problem: AreaProblem, order: tuple[Block, ...], numbers: Priorities, choose: Choose) -> _Result:
    masks = literal_masks(problem, order)
    areas: dict[Block, BlockArea] = {}
    certificate: Certificate | None = None
    for block, mask in masks.items():
        candidates, chosen = 0, None
        if block.want == "grasp":
            candidates = problem.allowed_in(block, surviving(mask))
            chosen = _picked(problem, block, candidates, choose) if candidates else None
            failed = chosen is None
        else:
            failed = mask != problem.wanted(block)
        if failed and certificate is None:
            certificate = literal_certificate(problem, order, masks, block)
        areas[block] = _area(problem, block, numbers[block], mask, candidates, chosen)
    return areas, certificate


def _committed(problem: AreaProblem, order: tuple[Block, ...], numbers: Priorities, choose: Choose) -> _Result:
    meetings = Meetings.of(order)
    domains = start_domains(problem, order)
    feasible = given_clash(problem, order) is None and propagate(problem, meetings, domains)
    covers, every = problem.covers, all_components(problem.sections.long_axis)
    taken: dict[Block, tuple[int, int]] = {}
    areas: dict[Block, BlockArea] = {}
    for block in order:
        # A palm that overhangs a patch keeps a hand from it; whether the camera still sees it, its rays decide.
        column = 1 if block.resource == "c" else 0
        mask = problem.wanted(block)
        for other, bits in taken.items():
            if block.meets(other):
                mask &= ~bits[column]
        candidates, chosen = 0, None
        if block.want != "grasp":
            wanted = problem.wanted(block)
            taken[block] = (problem.kept_out(block), wanted)
        elif feasible:
            candidates = domains[block]
            chosen = _picked(problem, block, candidates, choose)
            index = every.index(chosen)
            domains[block] = 1 << index
            propagate(problem, meetings, domains)
            taken[block] = (covers.covered[index], covers.used[index])
        areas[block] = _area(problem, block, numbers[block], mask, candidates, chosen)
    return areas, None if feasible else committed_certificate(problem, order)
