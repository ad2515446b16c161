"""Areas found in another way than the planner's: sets of patches listed one by one, and open cells of the surface."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from preshape.hal.transform import Matrix
from preshape.hal.world import FACES, Face, face_normal
from preshape.planner.component import Component
from preshape.planner.hand_cover import PALM_WIDTH
from preshape.planner.procedure import Block, Procedure
from preshape.tools.bench_areas import AreaCase

Patch = tuple[int, Face]
Patches = frozenset[Patch]
Choice = dict[Block, Component]


@dataclass(frozen=True)
class AreaOracle:
    """The surface of a case's box, cut at the given planes (m) across its longest edge."""

    case: AreaCase
    cuts: tuple[float, float]

    @property
    def axis(self) -> int:
        """Index of the longest edge's direction."""
        return int(np.argmax(self.case.box.size))

    @property
    def half(self) -> float:
        """Half the longest edge, m."""
        return float(self.case.box.size[self.axis] / 2)

    def whole(self) -> Patches:
        """Return every patch: a face and a section that has some of it."""
        letter = "xyz"[self.axis]
        end = {0: "-", 2: "+"}
        return frozenset((s, f) for s, f in product(range(3), FACES) if f[1] != letter or (s in end and f[0] == end[s]))

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

    def components(self, area: Patches) -> set[Component]:
        """Return the components in an area by trying all sections and faces."""
        found: set[Component] = set()
        for section, palm, first in product(range(3), FACES, FACES):
            if first[0] == "-" or palm[1] == first[1]:
                continue
            second = next(f for f in FACES if f == "-" + first[1])
            if {(section, palm), (section, first), (section, second)} <= area:
                found.add(Component(section, palm, (first, second)))
        if self.case.palm_on_end_caps_only:
            found = {c for c in found if c.palm[1] == "xyz"[self.axis]}
        return found

    def usable(self, procedure: Procedure, block: Block, components: Iterable[Component]) -> set[Component]:
        """Return the components that a block's hand can use in all its tasks."""
        usable = self.case.usable
        tasks = procedure.tasks[block.first - 1 : block.last]
        hand = block.resource
        if usable is None or hand == "c":
            return set(components)
        return {c for c in components if all(usable(hand, task, c) for task in tasks)}

    def covered(self, component: Component) -> Patches:
        """Return the patches used by a component, and those on the palm's face on which no second palm fits."""
        stations = (-self.half, *self.cuts, self.half)
        center = [(stations[k] + stations[k + 1]) / 2 for k in range(3)]
        used = set(component.patches)
        if component.palm[1] != "xyz"[self.axis]:
            used |= {(k, component.palm) for k in range(3) if abs(center[k] - center[component.section]) < PALM_WIDTH}
        return frozenset(used)

    def compatible(self, a: Component, b: Component) -> bool:
        """Return whether two hands can be on the box with these components."""
        return not (self.covered(a) & b.patches or self.covered(b) & a.patches)


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
    return bool(oracle.usable(procedure, block, oracle.components(area)))


def literal_some_order(oracle: AreaOracle, procedure: Procedure) -> bool:
    """Return whether any order of all blocks, given ones among them, serves all: by trying each."""

    def placed(areas: dict[Block, Patches], left: list[Block]) -> bool:
        if not left:
            return True
        for block in left:
            area = oracle.wanted(block).difference(*(areas[b] for b in areas if meet(b, block)))
            rest = [b for b in left if b != block]
            if literal_holds(oracle, procedure, block, area) and placed({**areas, block: area}, rest):
                return True
        return False

    return placed({}, list(procedure.blocks))


def committed_choices(
    oracle: AreaOracle, procedure: Procedure, blocks: Sequence[Block], fixed: Mapping[Block, Component] | None = None
) -> Iterator[Choice]:
    """Yield every joint choice of components for the grasps among these blocks that agrees with the fixed ones."""
    given = [b for b in blocks if b.want != "grasp"]
    if any(meet(a, b) and oracle.wanted(a) & oracle.wanted(b) for a, b in product(given, given)):
        return
    grasps = [b for b in blocks if b.want == "grasp"]
    domains: dict[Block, list[Component]] = {}
    for block in grasps:
        area = oracle.whole().difference(*(oracle.kept_out(g) for g in given if meet(g, block)))
        found = oracle.usable(procedure, block, oracle.components(area))
        domains[block] = [c for c in found if fixed is None or fixed.get(block, c) == c]

    def extended(chosen: Choice, left: list[Block]) -> Iterator[Choice]:
        if not left:
            yield chosen
            return
        block, *rest = left
        for component in domains[block]:
            if all(oracle.compatible(component, c) for b, c in chosen.items() if meet(b, block)):
                yield from extended({**chosen, block: component}, rest)

    yield from extended({}, sorted(grasps, key=lambda b: b.first))


@dataclass(frozen=True)
class Cells:
    """Open cells of a box's surface: every face cut along the compressed coordinates of all rectangles at hand."""

    size: Matrix
    lines: tuple[tuple[float, ...], ...]

    @staticmethod
    def of(size: Matrix, rectangles: Iterable[tuple[Matrix, Matrix]]) -> Cells:
        """Return the cells between all corners' coordinates."""
        corners = [corner for pair in rectangles for corner in pair] + [size / 2, -size / 2]
        return Cells(size, tuple(tuple(sorted({float(c[k]) for c in corners})) for k in range(3)))

    def centers(self) -> Iterator[Matrix]:
        """Yield the centre of every cell."""
        middles = [[(a + b) / 2 for a, b in zip(line, line[1:], strict=False)] for line in self.lines]
        for face in FACES:
            axis = "xyz".index(face[1])
            surface = float(face_normal(face) @ self.size / 2) * float(face_normal(face)[axis])
            spans = [middles[k] if k != axis else [surface * float(face_normal(face)[axis])] for k in range(3)]
            for point in product(*spans):
                yield np.array(point)

    def inside(self, rectangles: Sequence[tuple[Matrix, Matrix]]) -> frozenset[tuple[float, ...]]:
        """Return the cells that lie in any of the rectangles (lower and upper corner, equal along the normal)."""
        return frozenset(
            tuple(float(v) for v in p)
            for p in self.centers()
            if any(bool(np.all((lower <= p) & (p <= upper))) for lower, upper in rectangles)
        )


def slab(oracle: AreaOracle, low: float, high: float, face: Face) -> tuple[Matrix, Matrix]:
    """Return the rectangle of a face between two stations along the longest edge, m."""
    upper = np.array(oracle.case.box.size) / 2
    lower = -upper
    if face[1] != "xyz"[oracle.axis]:
        lower[oracle.axis], upper[oracle.axis] = low, high
    k = "xyz".index(face[1])
    lower[k] = upper[k] = (1.0 if face[0] == "+" else -1.0) * oracle.case.box.size[k] / 2
    return lower, upper
