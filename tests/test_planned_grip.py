"""Laws of grips made from planned options: who closes, how hard, and from where the hand comes."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.planned_grip import JOINT_SHARE, MOST_SQUEEZE_N, levers, planned_grip, squeeze_torques
from preshape.hal import sah_hand
from preshape.hal.layout import LAYOUT
from preshape.hal.sah_hand import ACTUATED
from preshape.planner.grasp_option import GraspOption
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.planner.option_choice import RankedOption
from preshape.tools.configuration import load_scenario
from preshape.tools.planned_task import plan_task


def ranked(scenario: str) -> tuple[RankedOption, ...]:
    return plan_task(load_scenario(scenario).drawn(0), again=False).before.options("r", 1)


OPTIONS = [r.option for name in ("l_carton", "cylinder", "tea_box") for r in ranked(name)]


@pytest.mark.parametrize("option", OPTIONS, ids=str)
def test_levers_are_how_far_a_fingertip_moves_into_the_object(option: GraspOption) -> None:
    kinematics, step = hand_kinematics(option.side), 1e-6
    x = option.X_object_palm[:3, :3].T @ option.X_object_pb[:3, 0]
    for finger, torques in levers(option).items():
        inward = -x if finger == "thumb" else x
        tip = sah_hand.FINGERS.index(finger)
        for joint in range(len(ACTUATED)):
            q = option.q_hand.copy()
            q[joint] += step
            moved = kinematics.tips(q)[0][tip] - kinematics.tips(option.q_hand)[0][tip]
            assert inward @ moved / step == pytest.approx(torques[joint], abs=1e-6)


@pytest.mark.parametrize("option", OPTIONS, ids=str)
def test_the_squeeze_is_as_strong_as_joints_and_panels_allow(option: GraspOption) -> None:
    torques = squeeze_torques(option)
    limit = LAYOUT.torque[LAYOUT.hand(option.side)]
    thumb = levers(option)["thumb"]
    bearing = int(np.argmax(np.abs(thumb)))
    squeeze = torques[bearing] / thumb[bearing]
    share = float(np.max(np.abs(torques) / limit))
    assert share <= JOINT_SHARE + 1e-9 and squeeze <= MOST_SQUEEZE_N + 1e-9
    assert share == pytest.approx(JOINT_SHARE) or squeeze == pytest.approx(MOST_SQUEEZE_N)


@pytest.mark.parametrize("option", OPTIONS, ids=str)
def test_the_thumb_presses_as_hard_as_the_others_together(option: GraspOption) -> None:
    torques, per_newton = squeeze_torques(option), levers(option)

    def force(finger: str) -> float:
        joint = ACTUATED.index(f"{finger}_flex")
        return float(torques[joint] / per_newton[finger][joint])

    assert force("thumb") == pytest.approx(sum(force(finger) for finger in option.fingers[1:]))
    assert force("thumb") > 5.0


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
