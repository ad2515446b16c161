"""Random procedures on random boxes: what the areas and the search for regrasps are checked and timed on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preshape.hal.world import Face, NominalBox, Opening, long_faces
from preshape.planner.area_problem import Usable
from preshape.planner.component import Component, all_components
from preshape.planner.procedure import HANDS, Block, Hand, Main, Procedure, Resource, Task, Want
from preshape.planner.sections import FINGER_WIDTH


@dataclass(frozen=True, slots=True, eq=False)
class AreaCase:
    """One random procedure on one random box."""

    procedure: Procedure
    box: NominalBox
    opening: Opening | None
    palm_on_end_caps_only: bool
    usable: Usable | None


def random_box(rng: np.random.Generator) -> tuple[NominalBox, Opening | None]:
    """Draw a box with edges of 40 to 500 mm, any of them the longest, 1 to 4 candidate faces, the opening or none."""
    size = rng.uniform(0.04, 0.30, 3)
    axis = int(rng.integers(3))
    size[axis] = max(size) + rng.uniform(0.06, 0.20)
    allowed = long_faces(axis)
    faces: list[Face] = [allowed[k] for k in rng.permutation(4)[: rng.integers(1, 5)]]
    tab = float(rng.uniform(0.1, 0.9) * (size[axis] - FINGER_WIDTH))
    box = NominalBox(size, tuple(faces), tab_size=(tab, 0.04))
    if rng.random() < 0.2:
        return box, None
    room = (size[axis] - FINGER_WIDTH - tab) / 2.0
    edges: list[Face] = [face for face in allowed if face[1] != faces[0][1]]
    return box, Opening(faces[0], edges[int(rng.integers(2))], float(rng.uniform(-0.95, 0.95) * room))


def _random_holders(rng: np.random.Generator, count: int) -> list[Hand | None]:
    holders: list[Hand | None] = [HANDS[int(rng.integers(2))]]
    while len(holders) < count:
        before, u = holders[-1], rng.random()
        if before is None or u < 0.15:
            holders.append(HANDS[int(rng.integers(2))] if before is None else None)
        else:
            holders.append(before if u < 0.7 else HANDS[1 - HANDS.index(before)])
    return holders


def _grasps(holders: list[Hand | None]) -> list[Block]:
    """Return the grasps that the holders need: each lasts until the task in which the box is passed on."""
    blocks: list[Block] = []
    first = 0
    for number in range(1, len(holders) + 1):
        if number == len(holders) or holders[number] != holders[first]:
            holder = holders[first]
            if holder is not None:
                blocks.append(Block(holder, first + 1, min(number + 1, len(holders))))
            first = number
    return blocks


def _free_runs(blocks: list[Block], resource: Resource, count: int) -> list[list[int]]:
    taken = {n for b in blocks if b.resource == resource for n in range(b.first, b.last + 1)}
    runs: list[list[int]] = [[]]
    for number in range(1, count + 1):
        if number in taken:
            runs.append([])
        else:
            runs[-1].append(number)
    return [run for run in runs if run]


def _extras(rng: np.random.Generator, blocks: list[Block], count: int) -> list[Block]:
    """Return work at the opening, second grasps and camera searches in tasks where the resource is free."""
    kinds: list[tuple[Resource, tuple[Want, ...], float]] = [
        ("r", ("opening", "opening", "grasp"), 0.6),
        ("l", ("opening", "opening", "grasp"), 0.6),
        ("c", ("middle", "candidates", "opening"), 0.4),
    ]
    found: list[Block] = []
    for resource, wants, chance in kinds:
        for run in _free_runs(blocks, resource, count):
            if rng.random() < chance:
                first, last = sorted(run[k] for k in rng.integers(len(run), size=2))
                found.append(Block(resource, first, last, wants[int(rng.integers(len(wants)))]))
    return found


def random_procedure(rng: np.random.Generator, tasks_max: int = 6) -> Procedure:
    """Draw a valid procedure of 2 to `tasks_max` tasks.

    Who holds the box is a random walk; free hands may work at the opening or grasp as well; a camera may search.
    A given area's resource is main in one of its tasks four times in five.
    """
    count = int(rng.integers(2, tasks_max + 1))
    holders = _random_holders(rng, count)
    blocks = _grasps(holders)
    blocks += _extras(rng, blocks, count)
    mains: list[Main] = ["none"] * count
    for block in blocks:
        if rng.random() < (0.8 if block.want != "grasp" else 0.2):
            mains[int(rng.integers(block.first, block.last + 1)) - 1] = block.resource
    tasks = [Task(f"t{k + 1}", int(rng.integers(1, 4)), mains[k], holders[k]) for k in range(count)]
    return Procedure(tuple(tasks), tuple(blocks[k] for k in rng.permutation(len(blocks))))


def random_usable(rng: np.random.Generator, procedure: Procedure, long_axis: int, share: float) -> Usable:
    """Draw which components each hand can use in each task, a share of all; added tasks are drawn, too."""
    names = (*(task.name for task in procedure.tasks), *(f"regrasp {hand}" for hand in HANDS))
    every = all_components(long_axis)
    able: dict[tuple[Hand, str], frozenset[Component]] = {
        (hand, name): frozenset(c for c in every if rng.random() < share) for hand in HANDS for name in names
    }
    return lambda hand, task, component: component in able[hand, task.name]


def random_case(rng: np.random.Generator, tasks_max: int = 6) -> AreaCase:
    """Draw a procedure, a box, whether palms go on end caps only (1 in 4) and what hands can use (all, or a share)."""
    box, opening = random_box(rng)
    procedure = random_procedure(rng, tasks_max)
    share = float(rng.choice([1.0, 0.8, 0.5]))
    usable = None if share == 1.0 else random_usable(rng, procedure, box.long_axis, share)
    return AreaCase(procedure, box, opening, bool(rng.random() < 0.25), usable)
