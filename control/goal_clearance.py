"""How close a hand's goal lies to things, so that the field vanishes there and nowhere else.

A preshape is nearer to the box than the field's range, so with a fixed range the pull and the push would meet
short of the goal. Each group's range against each body is therefore

    r = min(range, 0.9 c + e / 2)

with c the distance this group keeps from that body at the goal and e how far the hand still is from it. A hand
that comes straight is at most c + e away, so far out it is repelled as ever, and at the goal not at all.
"""

from __future__ import annotations

import numpy as np

from preshape.control.distances import Boxes, PairDistances, pair_distances
from preshape.control.field import Field, HandError, HandGoal
from preshape.control.groups import GROUPS, PART_GROUPS
from preshape.control.link_boxes import PART_COUNT, LinkBoxes, hand_nodes
from preshape.control.obstacles import MAX_BODIES
from preshape.hal.layout import LAYOUT, SIDES, Side
from preshape.hal.transform import Matrix, inverse, length

SHARE = 0.9
"""Share of the goal's clearance that the range keeps at the goal."""
SLOPE = 0.5
"""Growth of the range with the way still to go, m/m."""
PALM_LEVER = 0.15
"""Distance that a turn of the palm moves a fingertip by, m/rad."""
FINGER_LEVER = 0.08
"""Distance that a finger joint moves a fingertip by, m/rad."""


def goal_hand_boxes(side: Side, goal: HandGoal) -> Boxes:
    """Return the 18 boxes of a hand at its goal, whatever the arm does."""
    links = LinkBoxes()
    q = np.zeros(LAYOUT.dof)
    q[LAYOUT.hand(side)] = goal.joints
    poses, nodes = links.update(q), hand_nodes(side)
    X = goal.X_world_palm @ inverse(links.palm(side))
    R = X[:3, :3]
    return Boxes(poses.p_box[nodes] @ R.T + X[:3, 3], np.ascontiguousarray(R @ poses.R_box[nodes]), links.half[nodes])


def goal_clearance(field: Field, side: Side, goal: HandGoal) -> Matrix:
    """Return the least distance (3, B), m, of each group from each body's present boxes at a goal, >= 0.

    Bodies the hand does not see count as infinitely far. Costs about a millisecond: once per goal.
    """
    obstacles, hand = field.obstacles, SIDES.index(side)
    obstacles.track()
    clearance = np.full((len(GROUPS), MAX_BODIES), np.inf)
    boxes, links = Boxes(obstacles.p, obstacles.R, obstacles.half), goal_hand_boxes(side, goal)
    for body in range(obstacles.bodies):
        run = np.arange(obstacles.first[body], obstacles.last[body])
        run = run[obstacles.seen[hand, run]]
        if len(run) == 0:
            continue
        pairs = np.array([(part, box) for part in range(PART_COUNT) for box in run])
        out = PairDistances.empty(len(pairs))
        pair_distances(field.options.norm, links, boxes, pairs, out)
        least = out.distance.reshape(PART_COUNT, -1).min(axis=1)
        for group in range(len(GROUPS)):
            clearance[group, body] = max(0.0, float(least[group == PART_GROUPS].min()))
    return clearance


def goal_error(off: HandError) -> float:
    """Return how far (m) the farthest fingertip can still be from its goal: |e| + lever |turn| + lever |joints|_max."""
    fingers = float(np.abs(off.joints).max())
    return length(off.position) + PALM_LEVER * length(off.turn) + FINGER_LEVER * fingers


def shorten_ranges(field: Field, side: Side, clearance: Matrix, error: float) -> None:
    """Write a hand's ranges for the present error (m) of `goal_error`; each tick."""
    reach = np.minimum(field.parameters.range_m, SHARE * clearance + SLOPE * error)
    field.gains.reach[SIDES.index(side)] = reach
