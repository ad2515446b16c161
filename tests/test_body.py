"""Laws of requests and setpoints, on a device whose joints follow without dynamics."""

from __future__ import annotations

import numpy as np
import pytest
from kinematic_device import KinematicDevice

from preshape.control.body import Body
from preshape.control.controller import Setpoint
from preshape.control.motions import lead_palm
from preshape.hal.layout import LAYOUT, SIDES, Side
from preshape.hal.state import Mode, RobotCommand
from preshape.hal.transform import exp_so3, inverse, log_so3, transform
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import workcell

PERIOD_NS = 2_000_000
CELL = workcell(Scenario(name="cell"))
HOME = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.8, 0.8])


class Robot:
    """A body that drives a kinematic device."""

    def __init__(self) -> None:
        self.body, self.device = Body(CELL, PERIOD_NS * 1e-9), KinematicDevice()
        self.now_ns, self.sequence = 0, 0
        for side in SIDES:
            self.device.position[LAYOUT.arm(side)] = HOME
        self.device.open()
        self.device.arm(0)
        self.device.advance(0)
        self.body.follow(self.device.position.copy(), np.zeros(LAYOUT.dof))
        self.body.update(0, self.device.read(0))

    def tick(self) -> Setpoint:
        self.now_ns += PERIOD_NS
        self.device.advance(self.now_ns)
        self.body.update(self.now_ns, self.device.read(self.now_ns))
        setpoint = self.body.setpoint()
        self.sequence += 1
        command = RobotCommand(self.sequence, Mode.POSITION, setpoint.position, setpoint.torque_limit)
        assert self.device.write(command, self.now_ns)
        return setpoint


def test_the_first_setpoint_is_the_measured_position_and_stays_without_a_request() -> None:
    robot = Robot()
    measured = robot.device.position.copy()
    for _ in range(50):
        np.testing.assert_allclose(robot.tick().position, measured, atol=1e-9)


@pytest.mark.parametrize("side", SIDES)
def test_an_asked_palm_is_reached_and_the_other_arm_stays(side: Side) -> None:
    robot = Robot()
    body = robot.body
    other: Side = "left" if side == "right" else "right"
    rest = body.position[LAYOUT.arm(other)].copy()
    X_goal = body.palm(side) @ transform((0.03, -0.02, 0.05), exp_so3(np.array([0.1, -0.15, 0.1])))
    for _ in lead_palm(body, side, X_goal):
        robot.tick()
    for _ in range(250):
        robot.tick()
    off = inverse(X_goal) @ body.palm(side)
    assert np.linalg.norm(off[:3, 3]) < 1e-3
    assert np.linalg.norm(log_so3(off[:3, :3])) < 5e-3
    np.testing.assert_allclose(body.position[LAYOUT.arm(other)], rest, atol=1e-6)


def test_setpoints_keep_the_joint_limits_in_position_speed_and_acceleration_whatever_is_asked() -> None:
    robot, rng = Robot(), np.random.default_rng(3)
    positions = [robot.device.position.copy()] * 2
    for _ in range(40):
        for side in SIDES:
            robot.body.ask_arm(side, rng.uniform(-4.0, 4.0, 7))
            robot.body.ask_fingers(side, rng.uniform(-3.0, 3.0, 13))
        for _ in range(10):
            positions.append(robot.tick().position)
    dt = PERIOD_NS * 1e-9
    speed = np.diff(positions, axis=0) / dt
    assert np.all(np.array(positions) >= LAYOUT.lower - 1e-6) and np.all(np.array(positions) <= LAYOUT.upper + 1e-6)
    assert np.all(np.abs(speed) <= LAYOUT.velocity * 1.001 + 1e-6)
    assert np.all(np.abs(np.diff(speed, axis=0) / dt) <= LAYOUT.acceleration * 1.01 + 1e-3)
    assert np.abs(speed).max() > 0.3


def test_fingers_reach_their_angles_under_the_torque_limits_asked_for() -> None:
    robot = Robot()
    hand = LAYOUT.hand("right")
    goal = 0.6 * LAYOUT.lower[hand] + 0.4 * LAYOUT.upper[hand]
    limit = np.linspace(0.1, 0.5, 13)
    robot.body.ask_fingers("right", goal, limit)
    for _ in range(500):
        setpoint = robot.tick()
    np.testing.assert_allclose(robot.body.position[hand], goal, atol=1e-3)
    np.testing.assert_array_equal(setpoint.torque_limit[hand], limit)
    left = LAYOUT.hand("left")
    np.testing.assert_array_equal(setpoint.torque_limit[left], LAYOUT.torque[left])
    robot.body.ask_fingers("right", goal)
    np.testing.assert_array_equal(robot.tick().torque_limit[hand], LAYOUT.torque[hand])


def test_joint_angles_asked_for_end_the_leading_of_a_palm() -> None:
    robot = Robot()
    body = robot.body
    X_goal = body.palm("right") @ transform((0.05, 0.0, 0.0))
    body.ask_palm("right", X_goal)
    robot.tick()
    assert body.asked_palm("right") is X_goal
    body.ask_arm("right", HOME + 0.05)
    np.testing.assert_array_equal(body.asked_arm("right"), HOME + 0.05)
    for _ in range(500):
        robot.tick()
    np.testing.assert_allclose(body.position[LAYOUT.arm("right")], HOME + 0.05, atol=1e-3)


def test_the_age_of_every_sample_is_known() -> None:
    robot = Robot()
    robot.device.frozen = True
    for _ in range(5):
        robot.tick()
    np.testing.assert_array_equal(robot.body.age_ns, np.full(LAYOUT.dof, 5 * PERIOD_NS))
