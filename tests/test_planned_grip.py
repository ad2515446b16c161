"""Laws of grips made from planned options: who closes, how hard, and from where the hand comes."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.internal_forces import internal_forces, squeeze_limits
from preshape.control.planned_grip import option_contacts, planned_grip
from preshape.hal.sah_hand import ACTUATED, FINGERS
from preshape.planner.grasp_option import GraspOption
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.planner.option_choice import RankedOption
from preshape.tools.configuration import load_scenario
from preshape.tools.planned_task import plan_task


def ranked(scenario: str) -> tuple[RankedOption, ...]:
    return plan_task(load_scenario(scenario).drawn(0), again=False).before.options("r", 1)


OPTIONS = [r.option for name in ("l_carton", "cylinder", "tea_box") for r in ranked(name)]


@pytest.mark.parametrize("option", OPTIONS, ids=str)
def test_jacobians_are_how_the_fingertips_move_in_the_preshaping_box(option: GraspOption) -> None:
    kinematics, step = hand_kinematics(option.side), 1e-6
    R = option.X_object_pb[:3, :3].T @ option.X_object_palm[:3, :3]
    for finger, J in zip(option.fingers, option_contacts(option).jacobians, strict=True):
        tip = FINGERS.index(finger)
        for joint in range(len(ACTUATED)):
            q = option.q_hand.copy()
            q[joint] += step
            moved = R @ (kinematics.tips(q)[0][tip] - kinematics.tips(option.q_hand)[0][tip])
            np.testing.assert_allclose(moved / step, J[:, joint], atol=1e-6)


@pytest.mark.parametrize("option", OPTIONS, ids=str)
def test_thumb_and_fingers_press_on_opposite_faces_of_the_preshaping_box(option: GraspOption) -> None:
    contacts = option_contacts(option)
    assert np.all(contacts.points[0, 0] * contacts.points[1:, 0] < 0.0)
    assert np.all(np.sign(contacts.points[:, 0]) == -contacts.normals[:, 0])
    assert not contacts.normals[:, 1:].any()


@pytest.mark.parametrize("option", OPTIONS, ids=str)
def test_the_squeeze_is_as_strong_as_joints_and_panels_allow(option: GraspOption) -> None:
    limits = squeeze_limits(option.side)
    contacts = option_contacts(option)
    forces = internal_forces(contacts, option.fingers[1:], limits)
    torques = np.einsum("ijk,ij->k", contacts.jacobians, forces)
    squeeze = abs(float(forces[0, 0]))
    share = float(np.max(np.abs(torques) / limits.torque))
    assert share <= 1.0 + 1e-6 and squeeze <= limits.panel_n + 1e-6
    assert share == pytest.approx(1.0, abs=1e-3) or squeeze == pytest.approx(limits.panel_n, rel=1e-3)
    assert squeeze > 5.0
    assert squeeze == pytest.approx(float(np.abs(forces[1:, 0]).sum()))


@pytest.mark.parametrize("option", OPTIONS, ids=str)
def test_only_the_fingers_that_touch_close_and_the_hand_comes_square_to_the_palms_face(option: GraspOption) -> None:
    grip = planned_grip(option)
    driven = {name for name, torque in zip(ACTUATED, grip.torques, strict=True) if np.isfinite(torque)}
    assert driven == {f"{finger}_flex" for finger in option.fingers}
    assert all(grip.torques[ACTUATED.index(name)] > 0.0 for name in driven)
    assert grip.opposed == tuple(("thumb", finger) for finger in option.fingers[1:])
    assert np.array_equal(grip.preshape, option.q_hand)
    np.testing.assert_allclose(grip.X_box_palm[:3, :3] @ grip.advance, option.X_object_pb[:3, 2], atol=1e-12)


def test_a_plan_that_takes_another_option_keeps_all_of_them() -> None:
    plan = plan_task(load_scenario("l_carton").drawn(0), again=False).before
    options = plan.options("r", 1)
    taken = plan.taking("r", 1, options[2])
    assert taken.options("r", 1) == (options[2], *options[:2], *options[3:])
    assert taken.chosen.part is plan.chosen.part and len(taken.parts) == len(plan.parts)
    with pytest.raises(ValueError, match="no option of hand l"):
        plan.taking("l", 1, options[0])
