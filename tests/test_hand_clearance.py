"""Laws of the sampled clearance between a hand's parts and a box."""

import numpy as np

from preshape.hal.layout import Side
from preshape.hal.transform import Matrix, exp_so3, transform
from preshape.hal.world import OrientedBox
from preshape.planner.hand_clearance import box_distance, hand_clearance
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.planner.postures import PRESHAPE
from preshape.planner.preshape_qp import PreshapeProblem, solve
from preshape.planner.preshaping_box import box_from_component

HALF = np.array([0.03, 0.045, 0.10])
MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])
BOX = OrientedBox("box", np.eye(4), HALF)


def clearance(side: Side, X_world_palm: Matrix, q: Matrix) -> float:
    return hand_clearance(side, X_world_palm, q, [BOX])[0]


def test_distance_outside_is_that_of_the_closest_point_and_inside_that_of_the_closest_face() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.2, 0.2, (500, 3))
    distance = box_distance(points, HALF)
    closest = np.clip(points, -HALF, HALF)
    outside = np.any(np.abs(points) > HALF, axis=1)
    np.testing.assert_allclose(distance[outside], np.linalg.norm(points - closest, axis=1)[outside])
    np.testing.assert_allclose(distance[~outside], -(HALF - np.abs(points)).min(axis=1)[~outside])


def test_left_hand_is_as_clear_as_its_mirror_image() -> None:
    rng = np.random.default_rng(1)
    k = hand_kinematics("right")
    for _ in range(20):
        X = transform(rng.uniform(-0.2, 0.2, 3), exp_so3(rng.normal(size=3)))
        q = rng.uniform(k.lower, k.upper)
        right, left = clearance("right", X, q), clearance("left", MIRROR @ X @ MIRROR, q)
        np.testing.assert_allclose(right, left, atol=1e-12)


def test_clearance_changes_by_no_more_than_the_hand_moves() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        X = transform(rng.uniform(-0.2, 0.2, 3), exp_so3(rng.normal(size=3)))
        step = rng.normal(scale=0.02, size=3)
        before, after = (clearance("right", pose, PRESHAPE) for pose in (X, transform(step) @ X))
        assert abs(after - before) <= np.linalg.norm(step) + 1e-12


def test_clearance_is_that_of_the_nearest_box_wherever_it_stands() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        X = transform(rng.uniform(-0.2, 0.2, 3), exp_so3(rng.normal(size=3)))
        X_world_box = transform(rng.uniform(-0.2, 0.2, 3), exp_so3(rng.normal(size=3)))
        far = OrientedBox("far", transform((5.0, 0.0, 0.0)), HALF)
        moved = OrientedBox("moved", X_world_box, HALF)
        distance, name = hand_clearance("right", X_world_box @ X, PRESHAPE, [far, moved])
        assert name == "moved"
        np.testing.assert_allclose(distance, clearance("right", X, PRESHAPE), atol=1e-9)


def test_the_tea_boxs_preshape_touches_nothing() -> None:
    section = np.array([-0.03, -0.045, 0.10 - 0.2 / 3])
    for thumb_face in ("+x", "-x", "+y", "-y"):
        box = box_from_component("+z", thumb_face, section, HALF)
        problem = PreshapeProblem("right", box.X_object_pb, box.half, PRESHAPE)
        result = solve(problem)
        assert clearance("right", result.X_world_palm, result.joints) > 0.0
