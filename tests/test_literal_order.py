"""Orders of grasps in the literal reading, against all permutations."""

from __future__ import annotations

from collections import Counter
from itertools import permutations

import numpy as np

from preshape.planner.area_problem import AreaProblem
from preshape.planner.component import surviving
from preshape.planner.literal_group import GraspGroup, grasp_groups
from preshape.planner.literal_order import GraspForest, GraspSpan
from preshape.planner.sections import split
from preshape.tools.random_procedure import random_case

MOST_GRASPS = 5


def served(spans: tuple[GraspSpan, ...], order: tuple[int, ...]) -> bool:
    """Tell whether an order leaves each grasp a component: its region is what nobody higher that it meets has taken."""
    regions: dict[int, int] = {}
    for index in order:
        span = spans[index]
        region = span.free
        for higher, taken in regions.items():
            if span.meets(spans[higher]):
                region &= ~taken
        if not surviving(region) & span.allowed:
            return False
        regions[index] = region
    return True


def groups_with_regrasps(count: int) -> list[GraspGroup]:
    """Return what hangs together in random procedures, with none, one and two added regrasps."""
    rng = np.random.default_rng(5)
    groups: list[GraspGroup] = []
    for _ in range(count):
        case = random_case(rng, 5)
        sections = split(case.box, case.opening)
        problem = AreaProblem(case.procedure, sections, case.opening, case.palm_on_end_caps_only, case.usable)
        groups += grasp_groups(problem)
    longer = [g for group in groups for g in group.longer()]
    longest = [g for group in longer for g in group.longer()]
    return [g for g in (*groups, *longer, *longest) if g.shares and len(g.spans) <= MOST_GRASPS]


def test_an_order_is_found_where_one_of_all_permutations_leaves_each_grasp_a_component() -> None:
    found: Counter[tuple[bool, int]] = Counter()
    for group in groups_with_regrasps(200):
        spans = group.spans
        order = GraspForest(spans).order()
        assert (order is not None) == any(served(spans, o) for o in permutations(range(len(spans)))), spans
        assert order is None or (sorted(order) == list(range(len(spans))) and served(spans, order)), spans
        found[order is not None, len(group.moves)] += 1
    assert all(found[ok, moves] > 4 for ok in (False, True) for moves in (0, 1, 2)), found
