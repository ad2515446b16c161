"""Planner against oracle on one case: areas in both readings, open cells, certificates, the fewest regrasps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from preshape.hal.world import Face
from preshape.planner.areas import Areas, Reading, plan_areas
from preshape.planner.certificate import Certificate
from preshape.planner.component import Component
from preshape.planner.priorities import checked_order
from preshape.planner.procedure import Block
from preshape.planner.regrasp_search import RegraspPlan, fewest_regrasps
from preshape.planner.sections import split
from preshape.tools.area_oracle import (
    AreaOracle,
    Cells,
    Patches,
    committed_choice,
    exhaustive_regrasps,
    feasible,
    literal_holds,
    literal_patches,
    meet,
)
from preshape.tools.random_procedure import AreaCase

READINGS: tuple[Reading, Reading] = ("literal", "committed")

REGRASPS_MAX = 2
"""Most added regrasps that the exhaustive search tries."""

_Empties = Callable[[AreaOracle, tuple[Block, ...]], bool]
"""Whether these blocks leave the certificate's block without an area, under an oracle's restrictions."""


@dataclass(frozen=True, slots=True)
class CaseCheck:
    """One case in one reading: what differed (nothing, if all is well), whether it had areas, its fewest regrasps."""

    differences: tuple[str, ...]
    feasible: bool
    regrasps: int | None


def check_case(case: AreaCase, reading: Reading) -> CaseCheck:
    """Compare the planner's areas, candidates, certificate and fewest regrasps of a case with the oracle's."""
    # Where the sections are cut is taken from the planner; all that lies on them is found anew.
    oracle = AreaOracle(case, split(case.box, case.opening).cuts)
    areas, found = planned_areas(case, reading), planned_regrasps(case, reading)
    differ = _literal_differences if reading == "literal" else _committed_differences
    differences = (
        *differ(oracle, areas),
        *_cell_differences(oracle, areas),
        *_regrasp_differences(oracle, reading, found),
    )
    return CaseCheck(differences, areas.feasible, None if found.certificate else found.regrasps)


def planned_areas(case: AreaCase, reading: Reading) -> Areas:
    """Return the planner's areas of a case."""
    caps, usable = case.palm_on_end_caps_only, case.usable
    return plan_areas(case.procedure, case.box, case.opening, reading, caps, usable=usable)


def planned_regrasps(case: AreaCase, reading: Reading) -> RegraspPlan:
    """Return the planner's fewest regrasps of a case."""
    caps, usable = case.palm_on_end_caps_only, case.usable
    return fewest_regrasps(case.procedure, case.box, case.opening, reading, caps, usable, REGRASPS_MAX)


def _literal_differences(oracle: AreaOracle, areas: Areas) -> Iterator[str]:
    procedure = areas.procedure
    expected = literal_patches(oracle, checked_order(procedure, areas.priorities))
    served = {block: literal_holds(oracle, procedure, block, patches) for block, patches in expected.items()}
    for area in areas.blocks:
        patches = expected[area.block]
        components = oracle.components(patches) if area.block.want == "grasp" else frozenset[Component]()
        if area.region.patches != patches:
            yield f"{area.block}: region differs in {sorted(area.region.patches ^ patches)}"
        if frozenset(area.components) != components:
            yield f"{area.block}: components"
        if frozenset(area.candidates) != oracle.able(procedure, area.block, components):
            yield f"{area.block}: candidates"
        if (area.chosen in area.candidates) != bool(area.candidates):
            yield f"{area.block}: choice"
    if all(served.values()) != areas.feasible:
        yield f"feasible: {areas.feasible}, oracle: {all(served.values())}"
    elif areas.certificate is not None:
        yield from _literal_cause_differences(oracle, areas, expected, areas.certificate)


def _literal_cause_differences(
    oracle: AreaOracle, areas: Areas, expected: dict[Block, Patches], cause: Certificate
) -> Iterator[str]:
    def empties(at: AreaOracle, blocks: tuple[Block, ...]) -> bool:
        area = at.wanted(cause.block).difference(*(expected[b] for b in blocks))
        return not literal_holds(at, areas.procedure, cause.block, area)

    if any(not meet(b, cause.block) or areas.priorities[b] > areas.priorities[cause.block] for b in cause.constraints):
        yield f"certificate names an area of lower priority or of other tasks: {cause}"
    yield from _cause_differences(oracle, cause, cause.constraints, empties)


def _committed_differences(oracle: AreaOracle, areas: Areas) -> Iterator[str]:
    procedure, fixed = areas.procedure, dict[Block, Component]()
    possible = feasible(oracle, procedure, "committed")
    if possible != areas.feasible:
        yield f"feasible: {areas.feasible}, oracle: {possible}"
        return
    if areas.certificate is not None:
        cause = areas.certificate

        def empties(at: AreaOracle, blocks: tuple[Block, ...]) -> bool:
            return committed_choice(at, procedure, blocks) is None

        yield from _cause_differences(oracle, cause, (cause.block, *cause.constraints), empties)
        return
    by_block = {area.block: area for area in areas.blocks}
    for block in checked_order(procedure, areas.priorities):
        area = by_block[block]
        if block.want != "grasp":
            continue
        every = oracle.components(oracle.whole())
        joint = [(c, committed_choice(oracle, procedure, procedure.blocks, {**fixed, block: c})) for c in every]
        choices = {c for c, found in joint if found is not None}
        if set(area.candidates) != choices:
            yield f"{block}: {len(area.candidates)} candidates, oracle: {len(choices)}"
        if area.chosen is None or area.chosen not in area.candidates:
            yield f"{block}: choice"
        else:
            fixed[block] = area.chosen


def _cause_differences(
    oracle: AreaOracle, cause: Certificate, blocks: tuple[Block, ...], empties: _Empties
) -> Iterator[str]:
    """Yield what is wrong with a certificate: it must empty the area, and with anything less there must be one."""
    caps, usable = cause.palm_on_end_caps_only, oracle.case.usable if cause.availability else None
    at = oracle.restricted(caps, usable)
    if not empties(at, blocks):
        yield f"certificate does not hold: {cause}"
    less = [(at, tuple(b for b in blocks if b != one)) for one in blocks]
    if caps:
        less.append((oracle.restricted(False, usable), blocks))
    if cause.availability:
        less.append((oracle.restricted(caps, None), blocks))
    if any(empties(*some) for some in less):
        yield f"certificate can be reduced: {cause}"


def _cell_differences(oracle: AreaOracle, areas: Areas) -> Iterator[str]:
    """Yield the areas that differ from those found cell by cell, by the same subtraction on sets of cells."""
    cells, taken = Cells(oracle), dict[Block, tuple[frozenset[object], frozenset[object]]]()
    by_block = {area.block: area for area in areas.blocks}
    if not cells.tab() <= cells.in_rectangles([areas.sections.rectangle((1, face)) for face in _opened(oracle.case)]):
        yield "the opening's patch does not hold its tab"
    for block in checked_order(areas.procedure, areas.priorities):
        area = by_block[block]
        expected = cells.wanted(block).difference(
            *(bits[block.resource == "c"] for other, bits in taken.items() if meet(other, block))
        )
        if cells.in_rectangles([areas.sections.rectangle(patch) for patch in area.region]) != expected:
            yield f"{block}: cells"
        if areas.reading == "literal":
            taken[block] = expected, expected
        elif block.want != "grasp":
            taken[block] = cells.swept(block), cells.wanted(block)
        elif area.chosen is not None:
            taken[block] = cells.covered(area.chosen), cells.used(area.chosen)


def _opened(case: AreaCase) -> tuple[Face, ...]:
    return () if case.opening is None else (case.opening.face,)


def _regrasp_differences(oracle: AreaOracle, reading: Reading, found: RegraspPlan) -> Iterator[str]:
    fewest = exhaustive_regrasps(oracle, reading, REGRASPS_MAX)
    planned = None if found.certificate else found.regrasps
    # The committed search has no limit: beyond the exhaustive one's, that finds none.
    if (planned if planned is None or planned <= REGRASPS_MAX else None) != fewest:
        yield f"regrasps: {planned}, exhaustive: {fewest}"
        return
    if planned is None:
        return
    added = sum(task.regrasps is not None for task in found.procedure.tasks)
    if added != planned:
        yield f"regrasps: {planned}, but {added} tasks were added"
    case = replace(oracle.case, procedure=found.procedure)
    caps, usable = case.palm_on_end_caps_only, case.usable
    areas = plan_areas(
        case.procedure, case.box, case.opening, reading, caps, usable=usable, priorities=found.priorities
    )
    if not areas.feasible or not feasible(oracle, found.procedure, reading):
        yield f"the procedure with {planned} regrasps has no areas"
