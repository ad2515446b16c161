"""Laws of the hand's forward kinematics: equal to MuJoCo's on the same description, Jacobians equal to differences."""

import mujoco
import numpy as np
import pytest

from preshape.hal import sah_hand
from preshape.hal.description import robot_urdf
from preshape.hal.layout import HAND_DOF, SIDES, Side
from preshape.hal.transform import Matrix, log_so3
from preshape.planner.hand_kinematics import PART_NAMES, HandKinematics, hand_kinematics


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(robot_urdf())
    spec.compiler.fusestatic = False
    return spec.compile()


def _pose(data: mujoco.MjData, name: str) -> Matrix:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = data.body(name).xmat.reshape(3, 3), data.body(name).xpos
    return X


def _set(model: mujoco.MjModel, data: mujoco.MjData, k: HandKinematics, q: Matrix) -> None:
    for joint in sah_hand.JOINTS:
        angle = q[sah_hand.ACTUATED.index(joint.coupled_to or joint.name)]
        data.qpos[model.joint(f"{k.side}_{joint.name}").qposadr[0]] = angle
    mujoco.mj_kinematics(model, data)


@pytest.mark.parametrize("side", SIDES)
def test_frames_equal_mujoco_on_the_same_description(model: mujoco.MjModel, side: Side) -> None:
    k, data, rng = hand_kinematics(side), mujoco.MjData(model), np.random.default_rng(1)
    for _ in range(20):
        q = rng.uniform(k.lower, k.upper)
        _set(model, data, k, q)
        X_palm_world = np.linalg.inv(_pose(data, f"{side}_palm"))
        for name, X in zip(PART_NAMES, k.part_poses(q), strict=True):
            np.testing.assert_allclose(X, X_palm_world @ _pose(data, f"{side}_{name}"), atol=1e-10)
        for finger, X in zip(sah_hand.FINGERS, k.tip_poses(q), strict=True):
            np.testing.assert_allclose(X, X_palm_world @ _pose(data, f"{side}_{finger}_tip"), atol=1e-10)


@pytest.mark.parametrize("side", SIDES)
def test_tip_jacobian_equals_finite_differences(side: Side) -> None:
    k, rng, e = hand_kinematics(side), np.random.default_rng(2), 1e-6
    for _ in range(20):
        q = rng.uniform(k.lower, k.upper)
        numeric = np.stack([(k.tips(q + e * v)[0] - k.tips(q - e * v)[0]) / (2 * e) for v in np.eye(HAND_DOF)], axis=-1)
        np.testing.assert_allclose(k.tips(q)[1], numeric, atol=1e-8)


@pytest.mark.parametrize("side", SIDES)
def test_part_jacobians_equal_finite_differences(side: Side) -> None:
    k, rng, e = hand_kinematics(side), np.random.default_rng(3), 1e-6
    for _ in range(5):
        q = rng.uniform(k.lower, k.upper)
        J = k.part_jacobians(q)
        for joint, v in enumerate(np.eye(HAND_DOF)):
            after, before = k.part_poses(q + e * v), k.part_poses(q - e * v)
            np.testing.assert_allclose(J[:, :3, joint], (after[:, :3, 3] - before[:, :3, 3]) / (2 * e), atol=1e-8)
            for part in range(len(PART_NAMES)):
                turned = log_so3(after[part, :3, :3] @ before[part, :3, :3].T) / (2 * e)
                np.testing.assert_allclose(J[part, 3:, joint], turned, atol=1e-8)


def test_left_hand_mirrors_the_right_in_y() -> None:
    right, left, rng = hand_kinematics("right"), hand_kinematics("left"), np.random.default_rng(4)
    for _ in range(10):
        q = rng.uniform(right.lower, right.upper)
        np.testing.assert_allclose(left.tips(q)[0], right.tips(q)[0] * [1.0, -1.0, 1.0], atol=1e-12)


def test_tips_lie_where_tip_poses_say() -> None:
    k = hand_kinematics("right")
    q = (k.lower + k.upper) / 2
    np.testing.assert_allclose(k.tips(q)[0], k.tip_poses(q)[:, :3, 3], atol=1e-14)


def test_wrong_number_of_joints_is_refused_with_the_valid_names() -> None:
    with pytest.raises(ValueError, match="thumb_opp"):
        hand_kinematics("right").tips(np.zeros(17))
