"""Areas found in another way than the planner's: sets of patches listed one by one, and open cells of the surface."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from preshape.hal.transform import Matrix
from preshape.hal.world import FACES, Face, face_normal
from preshape.planner.area_problem import Usable
from preshape.planner.areas import Reading
from preshape.planner.component import Component
from preshape.planner.hand_cover import PALM_WIDTH
from preshape.planner.procedure import HANDS, Block, Hand, Procedure, Task
from preshape.planner.regrasp_move import needs_helper, with_regrasps
from preshape.tools.random_procedure import AreaCase

Patch = tuple[int, Face]
Patches = frozenset[Patch]
PAIRS: tuple[tuple[Face, Face], ...] = (("+x", "-x"), ("+y", "-y"), ("+z", "-z"))
Choice = dict[Block, Component]


class AreaOracle:
    """The surface of a case's box, cut at the given planes (m) across its longest edge."""

    def __init__(self, case: AreaCase, cuts: tuple[float, float]) -> None:
        """Keep the case; `axis` is the longest edge's, `half` half of it, m."""
        self.case, self.cuts = case, cuts
        self.axis = max(range(3), key=lambda k: float(case.box.size[k]))
        self.half = float(case.box.size[self.axis] / 2)
        self._components: dict[Patches, frozenset[Component]] = {}
        self._able: dict[tuple[Hand, tuple[Task, ...]], frozenset[Component]] = {}
        letter, end = "xyz"[self.axis], {0: "-", 2: "+"}
        self._whole: Patches = frozenset(
            (s, f) for s, f in product(range(3), FACES) if f[1] != letter or (s in end and f[0] == end[s])
        )
        every = self.components(self._whole)
        self._apart = {(a, b) for a, b in product(every, every) if not self._clash(a, b)}

    def restricted(self, palm_on_end_caps_only: bool, usable: Usable | None) -> AreaOracle:
        """Return the oracle of the same box with other restrictions on components."""
        return AreaOracle(replace(self.case, palm_on_end_caps_only=palm_on_end_caps_only, usable=usable), self.cuts)

    def whole(self) -> Patches:
        """Return every patch: a face and a section that has some of it."""
        return self._whole

    def wanted(self, block: Block) -> Patches:
        """Return what a block asks for."""
        candidates = self.case.box.candidate_faces
        opening = self.case.opening
        if block.want == "grasp":
            return self.whole()
        if block.want == "middle":
            return frozenset(p for p in self.whole() if p[0] == 1)
        if block.want == "candidates" or opening is None:
            return frozenset((1, f) for f in candidates)
        return frozenset({(1, opening.face)})

    def kept_out(self, block: Block) -> Patches:
        """Return what a given area keeps from a committed grasp."""
        if block.want != "opening" or block.resource == "c":
            return self.wanted(block)
        faces = self.case.box.candidate_faces if self.case.opening is None else (self.case.opening.face,)
        return frozenset((s, f) for s, f in product(range(3), faces))

    def components(self, area: Patches) -> frozenset[Component]:
        """Return the components in an area by trying all sections and faces."""
        if area not in self._components:
            self._components[area] = frozenset(self._listed(area))
        return self._components[area]

    def _listed(self, area: Patches) -> Iterator[Component]:
        for section, palm, (first, second) in product(range(3), FACES, PAIRS):
            on_cap = palm[1] == "xyz"[self.axis]
            allowed = on_cap or not self.case.palm_on_end_caps_only
            if allowed and palm not in (first, second) and {(section, f) for f in (palm, first, second)} <= area:
                yield Component(section, palm, (first, second))

    def able(self, procedure: Procedure, block: Block, components: frozenset[Component]) -> frozenset[Component]:
        """Return the components that a block's hand can use in all its tasks."""
        usable, hand = self.case.usable, block.resource
        if usable is None or hand == "c":
            return components
        tasks = procedure.tasks[block.first - 1 : block.last]
        if (hand, tasks) not in self._able:
            every = self.components(self._whole)
            self._able[hand, tasks] = frozenset(c for c in every if all(usable(hand, task, c) for task in tasks))
        return components & self._able[hand, tasks]

    def covered(self, component: Component) -> Patches:
        """Return the patches used by a component, and those on the palm's face on which no second palm fits."""
        stations = (-self.half, *self.cuts, self.half)
        center = [(stations[k] + stations[k + 1]) / 2 for k in range(3)]
        used = set(component.patches)
        if component.palm[1] != "xyz"[self.axis]:
            used |= {(k, component.palm) for k in range(3) if abs(center[k] - center[component.section]) < PALM_WIDTH}
        return frozenset(used)

    def _clash(self, a: Component, b: Component) -> bool:
        return bool(self.covered(a) & b.patches or self.covered(b) & a.patches)

    def compatible(self, a: Component, b: Component) -> bool:
        """Return whether two hands can be on the box with these components."""
        return (a, b) in self._apart


def meet(a: Block, b: Block) -> bool:
    """Return whether blocks of two resources have a task in common."""
    return a.resource != b.resource and bool({*range(a.first, a.last + 1)} & {*range(b.first, b.last + 1)})


def literal_patches(oracle: AreaOracle, order: Sequence[Block]) -> dict[Block, Patches]:
    """Return all areas in an order, in the literal reading."""
    areas: dict[Block, Patches] = {}
    for block in order:
        higher = (areas[b] for b in areas if meet(b, block))
        areas[block] = oracle.wanted(block).difference(*higher)
    return areas


def literal_holds(oracle: AreaOracle, procedure: Procedure, block: Block, area: Patches) -> bool:
    """Return whether an area serves its block."""
    if block.want != "grasp":
        return area == oracle.wanted(block)
    return bool(oracle.able(procedure, block, oracle.components(area)))


def literal_some_order(oracle: AreaOracle, procedure: Procedure) -> bool:
    """Return whether any order of all blocks, given ones among them, serves all: by trying each."""
    failed: set[frozenset[tuple[Block, Patches]]] = set()

    def placed(areas: dict[Block, Patches]) -> bool:
        left = [b for b in procedure.blocks if b not in areas]
        state = frozenset(areas.items())
        if not left or state in failed:
            return not left
        for block in left:
            area = oracle.wanted(block).difference(*(areas[b] for b in areas if meet(b, block)))
            if literal_holds(oracle, procedure, block, area) and placed({**areas, block: area}):
                return True
        failed.add(state)
        return False

    return placed({})


def committed_choice(
    oracle: AreaOracle, procedure: Procedure, blocks: Sequence[Block], fixed: Mapping[Block, Component] | None = None
) -> Choice | None:
    """Return a joint choice of components for the grasps among these blocks, by trying all; None if there is none.

    Grasps that do not meet, not even by way of others, are tried group by group. `fixed` ones are kept.
    """
    given = [b for b in blocks if b.want != "grasp"]
    if any(meet(a, b) and oracle.wanted(a) & oracle.wanted(b) for a, b in product(given, given)):
        return None
    domains: dict[Block, list[Component]] = {}
    for block in blocks:
        if block.want == "grasp":
            area = oracle.whole().difference(*(oracle.kept_out(g) for g in given if meet(g, block)))
            found = oracle.able(procedure, block, oracle.components(area))
            domains[block] = [c for c in found if fixed is None or fixed.get(block, c) == c]

    def extended(chosen: Choice, left: list[Block]) -> Choice | None:
        if not left:
            return chosen
        block, *rest = left
        for component in domains[block]:
            if all(oracle.compatible(component, c) for b, c in chosen.items() if meet(b, block)):
                found = extended({**chosen, block: component}, rest)
                if found is not None:
                    return found
        return None

    joint: Choice = {}
    left = set(domains)
    while left:
        group = _group(left)
        left -= group
        found = extended({}, sorted(group, key=lambda b: len(domains[b])))
        if found is None:
            return None
        joint |= found
    return joint


def _group(blocks: set[Block]) -> set[Block]:
    """Return some of the blocks that hang together."""
    group = {next(iter(blocks))}
    while more := {b for b in blocks - group if any(meet(a, b) for a in group)}:
        group |= more
    return group


def feasible(oracle: AreaOracle, procedure: Procedure, reading: Reading) -> bool:
    """Return whether a procedure has areas for all: with some order, or with some joint choice of components."""
    if reading == "literal":
        return literal_some_order(oracle, procedure)
    return committed_choice(oracle, procedure, procedure.blocks) is not None


def exhaustive_regrasps(oracle: AreaOracle, reading: Reading, limit: int) -> int | None:
    """Return the fewest added regrasps, at most `limit`, that make a case feasible, by trying every way to add them."""
    level = {oracle.case.procedure}
    for regrasps in range(limit + 1):
        if any(feasible(oracle, procedure, reading) for procedure in level):
            return regrasps
        level = {
            with_regrasps(procedure, (hand, after))
            for procedure in level
            for after in range(1, len(procedure.tasks))
            for hand in HANDS
            if needs_helper(procedure, hand, after) is not None
        }
    return None


@dataclass(frozen=True, slots=True)
class Cells:
    """Open cells of a box's surface as (face, coordinate of the centre along the longest edge, m).

    Each long face is cut along the compressed coordinates of all that lies on it; an area is a set of cells.
    """

    oracle: AreaOracle

    def all(self) -> frozenset[tuple[Face, float]]:
        """Return every cell."""
        case, half = self.oracle.case, self.oracle.half
        lines = {-half, *self.oracle.cuts, half}
        if case.opening is not None:
            lines |= {case.opening.offset + sign * case.box.tab_size[0] / 2 for sign in (-1, 1)}
        stations = sorted(lines)
        centers = [(a + b) / 2 for a, b in zip(stations, stations[1:], strict=False)]
        letter = "xyz"[self.oracle.axis]
        caps: list[tuple[Face, float]] = [(f, half if f[0] == "+" else -half) for f in FACES if f[1] == letter]
        return frozenset([*caps, *((f, at) for f in FACES if f[1] != letter for at in centers)])

    def tab(self) -> frozenset[tuple[Face, float]]:
        """Return the cells of the opening's tab."""
        opening = self.oracle.case.opening
        if opening is None:
            return frozenset()
        reach = self.oracle.case.box.tab_size[0] / 2
        return frozenset(c for c in self.all() if c[0] == opening.face and abs(c[1] - opening.offset) < reach)

    def in_rectangles(self, rectangles: Sequence[tuple[Matrix, Matrix]]) -> frozenset[tuple[Face, float]]:
        """Return the cells whose centres lie in any rectangle (lower and upper corner in the box's frame, m)."""
        size, axis = np.array(self.oracle.case.box.size), self.oracle.axis

        def inside(face: Face, station: float) -> bool:
            center = face_normal(face) * size / 2
            center[axis] = station
            return any(bool(np.all((lower <= center) & (center <= upper))) for lower, upper in rectangles)

        return frozenset(cell for cell in self.all() if inside(*cell))

    def wanted(self, block: Block) -> frozenset[tuple[Face, float]]:
        """Return what a block asks for."""
        case, letter = self.oracle.case, "xyz"[self.oracle.axis]
        if block.want == "grasp":
            return self.all()
        faces: tuple[Face, ...] = case.box.candidate_faces
        if block.want == "middle":
            faces = tuple(f for f in FACES if f[1] != letter)
        elif block.want == "opening" and case.opening is not None:
            faces = (case.opening.face,)
        low, high = self.oracle.cuts
        return frozenset(c for c in self.all() if c[0] in faces and low < c[1] < high)

    def swept(self, block: Block) -> frozenset[tuple[Face, float]]:
        """Return what a given area keeps from the other hand: whole faces, where a hand opens the box."""
        if block.want != "opening" or block.resource == "c":
            return self.wanted(block)
        opening = self.oracle.case.opening
        faces = self.oracle.case.box.candidate_faces if opening is None else (opening.face,)
        return frozenset(cell for cell in self.all() if cell[0] in faces)

    def used(self, component: Component) -> frozenset[tuple[Face, float]]:
        """Return the cells of a component's three patches."""
        stations = (-self.oracle.half, *self.oracle.cuts, self.oracle.half)
        low, high = stations[component.section : component.section + 2]
        faces = (component.palm, *component.pair)
        return frozenset(c for c in self.all() if c[0] in faces and low <= c[1] <= high)

    def covered(self, component: Component) -> frozenset[tuple[Face, float]]:
        """Return the cells of a component, and those where a second palm would meet its palm on a long face."""
        cells, stations = self.used(component), (-self.oracle.half, *self.oracle.cuts, self.oracle.half)
        own = sum(stations[component.section : component.section + 2]) / 2
        if component.palm[1] == "xyz"[self.oracle.axis]:
            return cells
        for low, high in zip(stations, stations[1:], strict=False):
            if abs((low + high) / 2 - own) < PALM_WIDTH:
                cells |= {c for c in self.all() if c[0] == component.palm and low < c[1] < high}
        return cells
