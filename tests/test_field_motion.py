"""A hand that follows the field: it preshapes around a box without touching it, and keeps off the other hand."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.contact_policy import Phase, Settling, apply_policy
from preshape.control.distances import NORMS
from preshape.control.field import Field, FieldOptions, HandGoal, hand_error
from preshape.control.goal_clearance import goal_clearance, goal_error, shorten_ranges
from preshape.control.groups import TIES
from preshape.control.link_boxes import SIDE_NODES, LinkBoxes
from preshape.control.obstacles import Kind, Obstacles
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.transform import Matrix, exp_so3, inverse, transform
from preshape.hal.world import OrientedBox

OPEN_HAND = np.array([1.571, 0.031, 0.049, 0.07, -0.162, -0.07, 0.765, -0.209, -0.07, 0.828, 0.262, 0.156, 0.205])
"""Thumb against fore and middle across a gap of about 0.11 m, ring behind."""
TIPS_CENTER = (0.0971, 0.0380)
DOWN = np.diag([1.0, -1.0, -1.0])
DT = 0.004


def place(links: LinkBoxes, X_world_palm: Matrix, joints: Matrix) -> None:
    """Put the right hand (with its arm) anywhere, the left one far away."""
    q = np.zeros(LAYOUT.dof)
    q[LAYOUT.hand("right")] = joints
    poses = links.update(q)
    D = X_world_palm @ inverse(links.palm("right"))
    for p, R in ((poses.p, poses.R), (poses.p_box, poses.R_box)):
        p[:SIDE_NODES] = p[:SIDE_NODES] @ D[:3, :3].T + D[:3, 3]
        R[:SIDE_NODES] = D[:3, :3] @ R[:SIDE_NODES]
        p[SIDE_NODES:] += (0.0, 3.0, 0.0)


def standing_box(options: FieldOptions) -> tuple[Field, HandGoal]:
    """The tea box standing on the table and the preshape around its upper end."""
    links = LinkBoxes()
    obstacles = Obstacles(links)
    table = OrientedBox("table", transform((0.0, 0.0, -0.025)), np.array([0.4, 0.6, 0.025]))
    obstacles.add("table", Kind.ENVIRONMENT, [table])
    obstacles.add("box", Kind.OBJECT, [OrientedBox("box", transform((0.0, 0.0, 0.1)), np.array([0.03, 0.045, 0.1]))])
    p_goal = np.array([0.0, 0.0, 0.40]) - DOWN @ np.array([*TIPS_CENTER, 0.0])
    return Field(links, obstacles, options), HandGoal(transform(p_goal, DOWN), OPEN_HAND)


def follow(field: Field, goal: HandGoal, X: Matrix, joints: Matrix) -> tuple[float, float, float]:
    """Follow the field; return the final error, the least distance met and the largest jump of velocity (rad/s)."""
    lower, upper = LAYOUT.lower[LAYOUT.hand("right")], LAYOUT.upper[LAYOUT.hand("right")]
    place(field.links, goal.X_world_palm, goal.joints)
    clearance = goal_clearance(field, "right", goal)
    clearance[:, : field.obstacles.index("table")] = np.inf
    settling, least, jump, last = Settling(0.012, 0.03), np.inf, 0.0, None
    for _ in range(1000):
        place(field.links, X, joints)
        off = hand_error(goal, X, joints)
        error = goal_error(off)
        phase = Phase.APPROACH if error > 0.08 else Phase.PRESHAPE
        settled = settling.update(error) if phase is Phase.PRESHAPE else 0.0
        apply_policy(field.gains, field.obstacles, "right", phase, settled=settled)
        shorten_ranges(field, "right", clearance, error)
        field.gains.reach[:, :, :4] = 0.0
        least = min(least, float(field.evaluate().distance[0].min()))
        motion = field.motion("right", off)
        if last is not None:
            jump = max(jump, float(np.abs(motion.twist[3:] - last).max()))
        last = motion.twist[3:]
        X = transform(X[:3, 3] + DT * motion.twist[:3], exp_so3(DT * motion.twist[3:]) @ X[:3, :3])
        joints = np.clip(joints + DT * motion.joints, lower, upper)
        if error < 0.003:
            break
    return error, least, jump


def start(rng: np.random.Generator, goal: HandGoal) -> tuple[Matrix, Matrix]:
    shift = np.array([*rng.uniform(-0.15, 0.15, 2), rng.uniform(0.1, 0.2)])
    lower, upper = LAYOUT.lower[LAYOUT.hand("right")], LAYOUT.upper[LAYOUT.hand("right")]
    joints = np.clip(goal.joints + rng.normal(size=13) * 0.15, lower, upper)
    return transform(goal.X_world_palm[:3, 3] + shift, exp_so3(rng.normal(size=3) * 0.2) @ DOWN), joints


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("ties", TIES)
def test_the_hand_preshapes_around_the_box_without_touching_it(norm, ties) -> None:
    rng = np.random.default_rng(2)
    for _ in range(3):
        field, goal = standing_box(FieldOptions(norm=norm, ties=ties))
        error, least, _ = follow(field, goal, *start(rng, goal))
        assert error < 0.003
        assert least > 0.0


def test_smooth_ties_make_smaller_jumps_than_hard_ones() -> None:
    jumps = {}
    for ties in TIES:
        rng = np.random.default_rng(2)
        field, goal = standing_box(FieldOptions(ties=ties))
        jumps[ties] = [follow(field, goal, *start(rng, goal))[2] for _ in range(4)]
    assert max(jumps["smooth"]) < 0.5 * max(jumps["hard"])


def test_a_hand_is_repelled_by_the_other_hand_and_by_both_arms_but_never_by_itself() -> None:
    links = LinkBoxes()
    q = np.zeros(LAYOUT.dof)
    q[LAYOUT.hand("right")] = q[LAYOUT.hand("left")] = 0.5
    place(links, transform((0.0, 0.0, 1.0)), np.full(13, 0.5))
    obstacles = Obstacles(links)
    field = Field(links, obstacles)
    alone = field.evaluate()
    hands = {side: obstacles.index(f"{side}_hand") for side in SIDES}
    assert np.all(np.isinf(alone.distance[0, :, hands["right"]])) and np.all(
        np.isinf(alone.distance[0, :, hands["left"]])
    )
    gap = links.poses.p_box[SIDE_NODES:].mean(axis=0) - links.poses.p_box[:SIDE_NODES].mean(axis=0)
    for p in (links.poses.p, links.poses.p_box):
        p[SIDE_NODES:] -= gap + (0.0, 0.0, 0.02)
    results = field.evaluate()
    assert np.isfinite(results.distance[0, :, hands["left"]]).any()
    assert np.isfinite(results.distance[1, :, hands["right"]]).any()
    assert np.isfinite(results.distance[0, :, obstacles.index("left_arm")]).any()
    assert np.all(np.isinf(results.distance[0, :, hands["right"]]))
    assert np.all(np.isinf(results.distance[1, :, hands["left"]]))
