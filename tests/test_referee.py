"""The referee on scripted truths in physics."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest

from preshape.hal.layout import LAYOUT
from preshape.hal.transform import Matrix, transform
from preshape.sim_backend.contact_rules import PARTS
from preshape.sim_backend.contact_scan import (
    FINGER_OUTSIDE,
    LEFT_ON_BOX,
    OTHER_ON_BOX,
    RIGHT_ON_BOX,
    TABLE_ON_BOX,
    THUMB_INSIDE,
    ContactScan,
)
from preshape.sim_backend.kicks import KickSchedule
from preshape.sim_backend.referee import Referee
from preshape.sim_backend.scenario import DisturbanceSection, ObstacleSection, OpeningSection, Scenario
from preshape.sim_backend.simulation import Simulation, home_position

SCENARIO = Scenario(name="referee").drawn(0)


def world(scenario: Scenario = SCENARIO) -> tuple[Simulation, Referee]:
    simulation = Simulation(scenario)
    return simulation, Referee(simulation)


def put_box(simulation: Simulation, X_world_box: Matrix) -> None:
    address = simulation.model.joint("box").qposadr[0]
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, X_world_box[:3, :3].ravel())
    simulation.data.qpos[address : address + 7] = [*X_world_box[:3, 3], *quat]


def body_pose(simulation: Simulation, name: str) -> Matrix:
    body = simulation.data.body(name)
    return transform(body.xpos, body.xmat.reshape(3, 3))


def test_a_world_left_alone_has_no_fault_but_the_tasks_not_done() -> None:
    simulation, referee = world()
    simulation.step(300)
    verdict = referee.verdict()
    assert verdict.undesired_contacts == () and verdict.self_contacts == ()
    assert not verdict.dropped and not verdict.crushed and not verdict.success
    assert verdict.max_panel_load_n["-z"] == pytest.approx(0.15 * 9.81, rel=0.05)
    assert 0.0 < verdict.max_torque_ratio < 0.5 and verdict.hold_slip_mm == 0.0
    assert [task.done for task in verdict.tasks] == [False] * 5
    assert referee.stage == 1 and not referee.held
    assert json.loads(json.dumps(verdict.as_dict()))["torn_fraction"] == 0.0


def test_a_falling_box_is_dropped() -> None:
    simulation, referee = world()
    put_box(simulation, transform((0.55, -0.3, 0.25)))
    simulation.step(19)
    assert not referee.verdict().dropped
    simulation.step(3)
    assert referee.verdict().dropped


def test_a_box_below_the_table_is_dropped() -> None:
    simulation, referee = world()
    put_box(simulation, transform((1.3, 0.0, -0.5)))
    simulation.step(2)
    assert referee.verdict().dropped


@pytest.mark.parametrize(("press_n", "crushed"), [(22.0, False), (25.0, True)])
def test_a_panel_is_crushed_above_its_load(press_n: float, crushed: bool) -> None:
    simulation, referee = world()
    simulation.step(50)
    simulation.kick((0.0, 0.0, -press_n), 0.2)
    simulation.step(200)
    verdict = referee.verdict()
    assert verdict.max_panel_load_n["-z"] == pytest.approx(press_n + 0.15 * 9.81, rel=0.05)
    assert verdict.crushed is crushed and ("crushed" in verdict.events) is crushed


def test_a_hand_on_the_table_is_undesired() -> None:
    simulation, referee = world()
    goal, joint = home_position(), LAYOUT.index("left_arm_3")
    for _ in range(900):
        goal[joint] -= 0.0015
        simulation.drives.follow(goal, 0.5 * LAYOUT.torque, 0.002)
        simulation.step(2)
        if referee.verdict().undesired_contacts:
            break
    (link, geom, seconds), *_ = referee.verdict().undesired_contacts
    assert link.startswith("left_") and geom == "table"
    assert seconds == pytest.approx(simulation.seconds, abs=0.0021)
    assert "undesired contact" in referee.verdict().failures


def test_fingers_of_one_hand_that_touch_are_reported_apart() -> None:
    simulation, referee = world()
    goal = home_position()
    goal[LAYOUT.index("left_thumb_opp")] = 1.5
    for finger in ("thumb", "fore"):
        for joint in ("flex", "pip"):
            goal[LAYOUT.index(f"left_{finger}_{joint}")] = 1.2
    simulation.drives.follow(goal, 0.3 * LAYOUT.torque, 0.5)
    simulation.step(1200)
    verdict = referee.verdict()
    assert verdict.self_contacts and verdict.undesired_contacts == ()
    assert all(a.startswith("left_") and b.startswith("left_") for a, b, _ in verdict.self_contacts)


def test_an_obstacle_on_the_box_is_undesired() -> None:
    section = ObstacleSection(
        name="wall", size_m=(0.1, 0.1, 0.1), position_m=(0.55, -0.3, 0.24), appears_s=0.05, room_m=0.0
    )
    simulation, referee = world(Scenario(name="hit", obstacles=(section,)))
    simulation.step(50)
    assert referee.verdict().undesired_contacts == ()
    simulation.step(5)
    assert any("obstacle_wall" in contact[:2] for contact in referee.verdict().undesired_contacts)


def test_a_box_that_falls_back_on_the_table_after_the_lift_is_undesired() -> None:
    simulation, referee = world()
    simulation.step(20)
    referee._stages.stage = 2
    simulation.step(1)
    assert {contact[0][:4] for contact in referee.verdict().undesired_contacts} <= {"box_", "lid_", "tab"}
    assert all(contact[1] == "table" for contact in referee.verdict().undesired_contacts)


def test_angles_and_tears_are_the_box_own() -> None:
    simulation, referee = world()
    for name in ("lid", "tab"):
        simulation.data.eq_active[simulation.model.equality(f"{name}_perforation").id] = 0
    assert simulation.tearing is not None
    simulation.tearing.intact[:] = False
    simulation.tearing.tab_torn = True
    simulation.data.qpos[simulation.model.joint("lid").qposadr[0]] = np.deg2rad(70.0)
    simulation.data.qpos[simulation.model.joint("tab").qposadr[0]] = np.deg2rad(40.0)
    simulation.step(5)
    verdict = referee.verdict()
    assert verdict.lid_angle_deg == pytest.approx(70.0, abs=2.0)
    assert verdict.tab_angle_deg == pytest.approx(40.0, abs=2.0)
    assert verdict.torn_fraction == 1.0 and verdict.tab_torn and "tab_torn" in verdict.events
    assert verdict.max_lid_angle_deg >= verdict.lid_angle_deg


def test_an_opening_is_judged_where_box_and_tab_are() -> None:
    opening = OpeningSection(face="-x", edge="-y", offset_m=0.006)
    simulation, referee = world(Scenario(name="told", opening=opening))
    X = simulation.X_world_box
    referee.report_opening("-x", "-y", 0.0, X)
    error = referee.verdict().opening_error
    assert error == pytest.approx((0.006, 0.0), abs=1e-6)
    assert referee.verdict().tasks[1].done
    referee.report_opening("+x", "-y", 0.006, X)
    assert not referee.verdict().tasks[1].done


def test_hand_contacts_slide_and_load_as_in_physics() -> None:
    simulation = Simulation(SCENARIO)
    X_palm = body_pose(simulation, "right_palm")
    # The box stands against the palm's front, 1 mm inside it, and slides along it.
    depth = 0.030 - 0.008 + 0.03 - 0.001
    put_box(simulation, X_palm @ transform((depth, -0.02, 0.12)))
    velocity = X_palm[:3, :3] @ np.array([0.0, 0.03, 0.04])
    start = simulation.model.joint("box").dofadr[0]
    simulation.data.qvel[start : start + 3] = velocity
    mujoco.mj_forward(simulation.model, simulation.data)
    contacts = ContactScan(simulation.model, SCENARIO)
    bits, _ = contacts.scan(simulation.data, 1, True)
    palm = PARTS.index("palm")
    assert bits & RIGHT_ON_BOX and bits & (LEFT_ON_BOX | TABLE_ON_BOX | OTHER_ON_BOX) == 0
    assert contacts.link_load[palm] > 0.1
    expected = -simulation.X_world_box[:3, :3].T @ velocity
    assert contacts.link_slide[palm] == pytest.approx(expected, abs=2e-3)
    assert contacts.face_load[1] == pytest.approx(contacts.link_load.sum(), rel=0.05)


@pytest.mark.parametrize(("part", "inside", "bit"), [("thumb", True, THUMB_INSIDE), ("fore", False, FINGER_OUTSIDE)])
def test_the_side_of_the_lid_that_is_touched_is_told(part: str, inside: bool, bit: int) -> None:
    simulation = Simulation(SCENARIO)
    X_tip = body_pose(simulation, f"right_{part}_dist")
    lid = np.deg2rad(120.0)
    simulation.data.qpos[simulation.model.joint("lid").qposadr[0]] = lid
    put_box(simulation, transform((5.0, 5.0, 5.0)))
    mujoco.mj_kinematics(simulation.model, simulation.data)
    X_box_lid = np.linalg.inv(body_pose(simulation, "box")) @ body_pose(simulation, "lid")
    # The fingertip lies on the lid's hinge strip, its axis along it, just deep enough to touch.
    height = -0.002 - 0.0125 + 0.001 if inside else 0.0125 - 0.001
    X_lid_tip = transform((0.025, 0.06, height), [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    put_box(simulation, X_tip @ np.linalg.inv(X_box_lid @ X_lid_tip))
    mujoco.mj_forward(simulation.model, simulation.data)
    bits, _ = ContactScan(simulation.model, SCENARIO).scan(simulation.data, 5, False)
    assert bits & (THUMB_INSIDE | FINGER_OUTSIDE) == bit


def test_kicks_come_once_in_each_listed_task_while_the_box_is_held() -> None:
    section = DisturbanceSection(kick_force_n=1.5, kick_duration_s=0.1, kick_tasks=(1, 3))
    simulation, referee = world(Scenario(name="kicked", disturbances=section))
    kicks = KickSchedule(simulation, referee)
    body = simulation.model.body("box").id
    simulation.step(500)
    assert kicks.given == []
    # A scripted hold: from now on the referee is told that the right hand alone carries the box.
    simulation.after_step.insert(1, lambda _: setattr(referee, "_bits", RIGHT_ON_BOX))
    simulation.step(450)
    assert [task for task, _ in kicks.given] == [1]
    referee._stages.stage = 3
    pushes = []
    for _ in range(520):
        simulation.step()
        pushes.append(np.linalg.norm(simulation.data.xfrc_applied[body, :3]))
    assert [task for task, _ in kicks.given] == [1, 3]
    assert max(pushes) == pytest.approx(1.5) and 99 <= np.count_nonzero(pushes) <= 100
