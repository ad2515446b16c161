"""Random approaches of the right hand to the standing tea box, among posts: what the field alone is measured on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preshape.control.distances import Boxes, PairDistances, pair_distances
from preshape.control.field import HandGoal
from preshape.control.goal_clearance import goal_hand_boxes
from preshape.control.grasp_choice import STANDOFF_M, back_off
from preshape.control.grips import cage_grip
from preshape.hal.layout import LAYOUT
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, exp_so3, transform
from preshape.hal.world import NominalBox, OrientedBox, Workcell
from preshape.planner.arm_ik import solve_palm
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import initial_box_pose, nominal_box, workcell
from preshape.sim_backend.simulation import home_position

ROOM_M = 0.015
"""Least distance of the hand's boxes from everything at the start, and from all but the tea box at the goal, m."""
MOST_POSTS = 6
TRIES = 400
ARM, HAND = LAYOUT.arm("right"), LAYOUT.hand("right")


@dataclass(frozen=True, slots=True, eq=False)
class RandomApproach:
    """One approach to be made: where box and posts stand, the goal, and the start.

    `X_box_palm` and `preshape` (13,), rad, are the goal, `position` (40,), rad, all joints at the start.
    """

    cell: Workcell
    box: NominalBox
    X_world_box: Matrix
    posts: tuple[OrientedBox, ...]
    X_box_palm: Matrix
    preshape: Vector
    position: Vector

    @property
    def things(self) -> tuple[OrientedBox, ...]:
        """All that the hand must not touch; the tea box is the first."""
        return OrientedBox("box", self.X_world_box, self.box.size / 2), *self.posts, *self.cell.statics


def random_approach(rng: np.random.Generator) -> RandomApproach:
    """Draw an approach whose hand has room and an arm at both its ends; `RuntimeError` when no try gives one."""
    for _ in range(TRIES):
        drawn = _draw(rng)
        if drawn is not None:
            return drawn
    raise RuntimeError(f"random_approach: none of {TRIES} tries gave the hand room and an arm at both ends")


def _draw(rng: np.random.Generator) -> RandomApproach | None:
    drawn = Scenario(name="approach").drawn(int(rng.integers(2**31)))
    cell, box, X_world_box = workcell(drawn), nominal_box(drawn), initial_box_pose(drawn)
    grip = cage_grip(box.size, "+z", "+y" if rng.random() < 0.5 else "-y", "right")
    X_box_palm = back_off(grip.X_box_palm_insert, STANDOFF_M)
    X_goal = X_world_box @ X_box_palm
    shift = np.array([*rng.uniform(-0.25, 0.25, 2), rng.uniform(-0.05, 0.20)])
    X_start = transform(X_goal[:3, 3] + shift, exp_so3(rng.normal(size=3) * 0.3) @ X_goal[:3, :3])
    way = X_goal[:2, 3], X_start[:2, 3]
    posts = tuple(_post(rng, *way, number) for number in range(int(rng.integers(1, MOST_POSTS + 1))))
    position = home_position()
    position[HAND] = np.clip(grip.preshape + rng.normal(size=13) * 0.3, LAYOUT.lower[HAND], LAYOUT.upper[HAND])
    base = cell.X_world_base["right"]
    goals, starts = (solve_palm("right", base, X) for X in (X_goal, X_start))
    if not len(goals) or not len(starts):
        return None
    position[ARM] = starts[int(np.argmin(np.abs(starts - position[ARM]).max(axis=1)))]
    approach = RandomApproach(cell, box, X_world_box, posts, X_box_palm, grip.preshape, position)
    things = Boxes.of(approach.things)
    at_goal = goal_hand_boxes("right", HandGoal(X_goal, grip.preshape))
    at_start = goal_hand_boxes("right", HandGoal(X_start, position[HAND]))
    if least_gap(at_start, things) < ROOM_M or least_gap(at_goal, Boxes.of(approach.things[1:])) < ROOM_M:
        return None
    return approach


def _post(rng: np.random.Generator, to: Vector, start: Vector, number: int) -> OrientedBox:
    """Return a post on the table, 0.25 to 0.60 m high, within 0.15 m of the straight way (2,), (2,) between palms."""
    half = np.array([*rng.uniform(0.01, 0.03, 2), rng.uniform(0.125, 0.30)])
    place = to + rng.uniform(0.0, 1.0) * (start - to) + rng.uniform(-0.15, 0.15, 2)
    turned = exp_so3(np.array([0.0, 0.0, rng.uniform(0.0, np.pi)]))
    return OrientedBox(f"post{number}", transform((*place, half[2]), turned), half)


def least_gap(boxes: Boxes, others: Boxes) -> float:
    """Return the least Euclidean distance between two sets of boxes, m, negative when they overlap."""
    pairs = np.indices((len(boxes.p), len(others.p))).reshape(2, -1).T.copy()
    out = PairDistances.empty(len(pairs))
    pair_distances("l2", boxes, others, pairs, out)
    return float(out.distance.min())
