"""The compiled kinematics against MuJoCo on the shared description, and its Jacobians against differences."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from preshape.control.link_boxes import NODES, LinkBoxes, arm_nodes, hand_nodes
from preshape.hal import sah_hand
from preshape.hal.description import capsule_links, robot_urdf
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.transform import exp_so3, transform


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(robot_urdf())
    spec.compiler.fusestatic = False
    return spec.compile()


def posed(model: mujoco.MjModel, q: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    for index, name in enumerate(LAYOUT.names):
        data.qpos[model.joint(name).qposadr] = q[index]
    for side in SIDES:
        for joint in sah_hand.JOINTS:
            if joint.coupled_to is not None:
                data.qpos[model.joint(f"{side}_{joint.name}").qposadr] = q[LAYOUT.index(f"{side}_{joint.coupled_to}")]
    mujoco.mj_kinematics(model, data)
    return data


def draws(count: int):
    rng = np.random.default_rng(0)
    return [rng.uniform(LAYOUT.lower, LAYOUT.upper) for _ in range(count)]


def test_link_frames_equal_those_of_mujoco(model) -> None:
    links = LinkBoxes()
    for q in draws(20):
        data, poses = posed(model, q), links.update(q)
        for node, name in enumerate(NODES):
            np.testing.assert_allclose(poses.p[node], data.body(name).xpos, atol=1e-9)
            np.testing.assert_allclose(poses.R[node], data.body(name).xmat.reshape(3, 3), atol=1e-9)


def test_boxes_bound_the_shapes_tightly(model) -> None:
    links = LinkBoxes()
    q = draws(1)[0]
    data, poses = posed(model, q), links.update(q)
    for geom in range(model.ngeom):
        name = model.body(model.geom_bodyid[geom]).name
        node = NODES.index(name)
        np.testing.assert_allclose(poses.p_box[node], data.geom_xpos[geom], atol=1e-9)
        size, R = model.geom_size[geom], data.geom_xmat[geom].reshape(3, 3)
        if name in capsule_links():
            size = np.array([size[0], size[0], size[1]])
        # The same box with its axes in another order: every half edge reaches exactly as far.
        reach = np.abs(poses.R_box[node].T @ R @ np.diag(size)).sum(axis=1)
        np.testing.assert_allclose(reach, links.half[node], atol=1e-9)


def test_palm_is_the_hand_base_frame(model) -> None:
    links = LinkBoxes()
    q = draws(1)[0]
    data = posed(model, q)
    links.update(q)
    for side in SIDES:
        np.testing.assert_allclose(links.palm(side)[:3, 3], data.body(f"{side}_palm").xpos, atol=1e-9)


def test_point_jacobians_equal_finite_differences() -> None:
    links = LinkBoxes()
    rng = np.random.default_rng(1)
    for q in draws(5):
        for node in ("right_thumb_dist", "left_ring_dist", "right_palm", "left_arm_link4"):
            n = NODES.index(node)
            links.update(q)
            local = rng.normal(size=3) * 0.03
            x = links.poses.p[n] + links.poses.R[n] @ local
            J = links.point_jacobian(node, x)
            for k in range(LAYOUT.dof):
                ends = []
                for step in (1e-6, -1e-6):
                    moved = q.copy()
                    moved[k] += step
                    links.update(moved)
                    ends.append(links.poses.p[n] + links.poses.R[n] @ local)
                np.testing.assert_allclose(J[:, k], (ends[0] - ends[1]) / 2e-6, atol=1e-8)


def test_moving_the_bases_moves_everything_rigidly() -> None:
    q = draws(1)[0]
    D = transform((0.1, -0.2, 0.3), exp_so3([0.1, 0.2, -0.3]))
    plain = LinkBoxes({side: np.eye(4) for side in SIDES})
    moved = LinkBoxes({side: D for side in SIDES})
    a, b = plain.update(q), moved.update(q)
    np.testing.assert_allclose(b.p_box, a.p_box @ D[:3, :3].T + D[:3, 3], atol=1e-12)


def test_each_hand_has_eighteen_parts_and_each_arm_eight_links() -> None:
    for side in SIDES:
        assert [NODES[n] for n in range(*hand_nodes(side).indices(99))] == [f"{side}_{part}" for part in sah_hand.PARTS]
        assert hand_nodes(side).stop - hand_nodes(side).start == 18
        assert arm_nodes(side).stop - arm_nodes(side).start == 8


def test_wrong_arguments_are_named() -> None:
    links = LinkBoxes()
    with pytest.raises(ValueError, match="40"):
        links.update(np.zeros(13))
    with pytest.raises(KeyError, match="right_palm"):
        links.point_jacobian("tail", np.zeros(3))
