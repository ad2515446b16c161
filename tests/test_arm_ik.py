"""Laws of the closed-form arm IK and of the arm's forward kinematics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from preshape.hal.description import robot_urdf
from preshape.hal.layout import SIDES, Side, arm_joint_names
from preshape.hal.transform import log_so3, rpy_matrix, transform
from preshape.planner.arm_ik import IkGrid, joint_range, link7_pose, solve_fixed_q7, solve_palm
from preshape.planner.arm_kinematics import arm_frames, arm_jacobian, manipulability, palm_pose

X_WORLD_BASE = transform((0.1, -0.3, 0.2), rpy_matrix((0.1, -0.2, 0.7)))


def _postures(count: int, margin: float = 0.0) -> np.ndarray:
    lower, upper = joint_range(margin)
    return np.random.default_rng(3).uniform(lower, upper, (count, 7))


@pytest.mark.parametrize("side", SIDES)
def test_every_link_frame_equals_that_of_the_description(side: Side) -> None:
    bases = {name: X_WORLD_BASE for name in SIDES}
    spec = mujoco.MjSpec.from_string(robot_urdf(bases, hands=True))
    spec.compiler.fusestatic = False
    model = spec.compile()
    data = mujoco.MjData(model)
    links = [f"{side}_arm_link{n}" for n in range(8)] + [f"{side}_palm"]
    for q in _postures(20):
        data.qpos[:] = 0.0
        for name, angle in zip(arm_joint_names(side), q, strict=True):
            data.joint(name).qpos[0] = angle
        mujoco.mj_kinematics(model, data)
        for link, X in zip(links, arm_frames(side, X_WORLD_BASE, q), strict=True):
            assert np.allclose(X[:3, 3], data.body(link).xpos, atol=1e-9)
            assert np.allclose(X[:3, :3].ravel(), data.body(link).xmat, atol=1e-9)


@pytest.mark.parametrize("side", SIDES)
def test_jacobian_equals_finite_differences(side: Side) -> None:
    step = 1e-6
    for q in _postures(50):
        J = arm_jacobian(side, X_WORLD_BASE, q)
        X = palm_pose(side, X_WORLD_BASE, q)
        for k in range(7):
            moved = palm_pose(side, X_WORLD_BASE, q + step * np.eye(7)[k])
            assert np.allclose((moved[:3, 3] - X[:3, 3]) / step, J[:3, k], atol=1e-5)
            assert np.allclose(log_so3(moved[:3, :3] @ X[:3, :3].T) / step, J[3:, k], atol=1e-5)


@pytest.mark.parametrize("side", SIDES)
def test_any_posture_is_among_the_solutions_of_its_own_pose(side: Side) -> None:
    lower, upper = joint_range()
    out = np.empty((8, 7))
    for q in _postures(2000):
        X = palm_pose(side, X_WORLD_BASE, q)
        count = solve_fixed_q7(link7_pose(side, X_WORLD_BASE, X), q[6], lower, upper, out)
        assert np.abs(out[:count] - q).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("side", SIDES)
def test_all_solutions_reach_the_pose_within_the_limits_less_the_margin(side: Side) -> None:
    margin = 0.1
    lower, upper = joint_range(margin)
    for q in _postures(60, margin):
        X = palm_pose(side, X_WORLD_BASE, q)
        solutions = solve_palm(side, X_WORLD_BASE, X, IkGrid(q7_samples=41, margin=margin))
        for solution in solutions:
            assert np.allclose(palm_pose(side, X_WORLD_BASE, solution), X, atol=1e-9)
            assert (solution >= lower).all() and (solution <= upper).all()


def test_solutions_of_one_redundancy_angle_are_distinct() -> None:
    lower, upper = np.full(7, -2 * np.pi), np.full(7, 2 * np.pi)
    out = np.empty((8, 7))
    for q in _postures(200):
        X = palm_pose("right", X_WORLD_BASE, q)
        count = solve_fixed_q7(link7_pose("right", X_WORLD_BASE, X), q[6], lower, upper, out)
        assert count >= 2
        for i in range(count):
            assert all(np.abs(out[i] - out[j]).max() > 1e-9 for j in range(i))


def test_a_pose_out_of_reach_has_no_solution() -> None:
    assert len(solve_palm("right", np.eye(4), transform((2.0, 0.0, 0.5)))) == 0


def test_a_pose_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="finite"):
        solve_palm("left", np.eye(4), transform((np.nan, 0.0, 0.5)))


def test_manipulability_vanishes_where_the_elbow_is_straight_over_the_base() -> None:
    q = np.array([0.0, 0.0, 0.0, -0.0698, 0.0, 0.0, 0.0])
    assert manipulability(arm_jacobian("right", np.eye(4), q)) < 0.01
