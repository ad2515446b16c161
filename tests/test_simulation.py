"""The physics as a whole: rest, determinism, obstacles, kicks, drives, watchdog."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand
from preshape.sim_backend.commanded_palm import CommandedPalm
from preshape.sim_backend.device import MujocoDevice
from preshape.sim_backend.lockstep import SimClock, open_lockstep
from preshape.sim_backend.robot_model import joint_addresses
from preshape.sim_backend.scenario import BoxSection, DrawSection, ObstacleSection, PerceptionSection, Scenario
from preshape.sim_backend.simulation import Simulation, home_position

DRAWN = Scenario(name="drawn", draw=DrawSection(position_m=0.05, yaw_deg=180.0, friction=(0.5, 0.8)))
MS = 1_000_000


@pytest.mark.parametrize("rest_face", ["-z", "-x", "-y"])
def test_box_rests_on_the_table_without_drifting(rest_face: str) -> None:
    simulation = Simulation(Scenario(name="rest", box=BoxSection(rest_face=rest_face, yaw_deg=33.0)))  # type: ignore[arg-type]
    simulation.step(200)
    before = simulation.X_world_box
    simulation.step(2000)
    after = simulation.X_world_box
    assert np.linalg.norm(after[:3, 3] - before[:3, 3]) < 2e-5
    assert np.linalg.norm(after[:3, :3] - before[:3, :3]) < 2e-4


def test_robot_stays_at_home_under_gravity() -> None:
    simulation = Simulation(DRAWN.drawn(0))
    simulation.step(500)
    joints = simulation.data.qpos[joint_addresses(simulation.model)[0]]
    # At its lower end stop a pip gives way by the little that the stop is soft.
    assert np.abs(joints - home_position()).max() < 0.01


def run(scenario: Scenario, steps: int) -> bytes:
    world = open_lockstep(scenario)
    world.device.open()
    world.device.arm(0)
    goal = home_position()
    for k in range(steps // 2):
        goal[LAYOUT.arm("right")] += 2e-4
        world.device.write(RobotCommand(k, Mode.POSITION, goal, LAYOUT.torque), world.clock.now_ns())
        world.clock.sleep_until_ns(world.clock.now_ns() + 2 * MS)
    state, sample = world.device.read(0), world.perception.object_pose(world.clock.now_ns())
    assert sample is not None
    return world.simulation.data.qpos.tobytes() + state.torque.tobytes() + sample.X_world_box.tobytes()


@pytest.mark.physics
def test_same_seed_and_commands_give_the_same_bytes_and_another_seed_others() -> None:
    assert run(DRAWN.drawn(3), 1000) == run(DRAWN.drawn(3), 1000)
    assert run(DRAWN.drawn(3), 200) != run(DRAWN.drawn(4), 200)


def test_an_obstacle_is_away_until_it_appears_and_then_moves() -> None:
    section = ObstacleSection(
        name="late",
        size_m=(0.1, 0.1, 0.1),
        position_m=(0.6, 0.0, 0.5),
        appears_s=0.05,
        velocity_m_per_s=(0.0, 0.1, 0.0),
    )
    simulation = Simulation(Scenario(name="obstacle", obstacles=(section,)))
    body = simulation.model.body("obstacle_late").id
    simulation.step(50)
    assert np.linalg.norm(simulation.data.xpos[body]) > 10.0
    simulation.step(101)
    assert simulation.data.xpos[body] == pytest.approx([0.6, 0.01, 0.5], abs=1e-9)


def test_an_obstacle_waits_until_there_is_room_for_it_and_one_that_is_there_from_the_start_does_not() -> None:
    waits = ObstacleSection(name="late", size_m=(0.04, 0.04, 0.04), position_m=(0.58, -0.18, 0.24), appears_s=0.02)
    scene = Scenario(name="obstacle", box=BoxSection(position_m=(0.58, -0.18)), obstacles=(waits,))
    simulation = Simulation(scene)
    body, joint = simulation.model.body("obstacle_late").id, simulation.model.joint("box").qposadr[0]
    # Under the spot stands the box, 0.20 m high: too near.
    simulation.step(50)
    assert np.isnan(simulation.obstacles.appeared_s[0]) and np.linalg.norm(simulation.data.xpos[body]) > 10.0
    simulation.data.qpos[joint] += 0.2
    simulation.step(2)
    assert simulation.obstacles.appeared_s[0] == pytest.approx(0.051, abs=1e-9)
    simulation.step()
    assert simulation.data.xpos[body] == pytest.approx(waits.position_m, abs=1e-9)
    there = msgspec.structs.replace(waits, appears_s=0.0)
    assert Simulation(msgspec.structs.replace(scene, obstacles=(there,))).obstacles.appeared_s[0] == 0.0


def test_a_kick_pushes_through_the_box_centre_and_ends() -> None:
    simulation = Simulation(Scenario(name="kick", box=BoxSection(center_of_mass_m=(0.0, 0.02, 0.03))))
    data = simulation.data
    data.qpos[simulation.model.joint("box").qposadr[0] + 2] = 1.0
    simulation.step()
    simulation.kick((1.5, 0.0, 0.0), 0.1)
    force, torque = data.xfrc_applied[simulation.model.body("box").id].reshape(2, 3).copy()
    lever = simulation.X_world_box[:3, 3] - data.xipos[simulation.model.body("box").id]
    assert np.allclose(force, (1.5, 0.0, 0.0)) and np.allclose(torque, np.cross(lever, force))
    assert np.linalg.norm(lever) > 0.01
    simulation.step(100)
    assert not data.xfrc_applied.any()
    assert data.qvel[simulation.model.joint("box").dofadr[0]] == pytest.approx(1.5 * 0.1 / 0.15, rel=0.1)


def test_a_ramp_is_followed_without_lag() -> None:
    simulation = Simulation(DRAWN.drawn(0))
    goal, joint = home_position(), LAYOUT.index("right_arm_4")
    for _ in range(250):
        goal[joint] += 0.001
        simulation.drives.follow(goal, LAYOUT.torque, 0.002)
        simulation.step(2)
    reached = simulation.data.qpos[joint_addresses(simulation.model)[0]][joint]
    assert abs(reached - goal[joint]) < 0.002


def test_a_request_above_the_limit_is_clipped_and_noted() -> None:
    simulation = Simulation(DRAWN.drawn(0))
    goal = home_position()
    goal[LAYOUT.index("right_fore_flex")] += 1.0
    simulation.drives.follow(goal, 1.5 * LAYOUT.torque, 0.002)
    simulation.step(5)
    assert (np.abs(simulation.data.actuator_force) <= LAYOUT.torque + 1e-12).all()
    assert simulation.drives.max_requested_ratio == pytest.approx(1.5)


def test_missed_commands_latch_a_fault_and_hold_until_armed_again() -> None:
    simulation = Simulation(DRAWN.drawn(0))
    device, clock = MujocoDevice(simulation), SimClock(simulation)
    device.open()
    device.arm(0)
    clock.sleep_until_ns(100 * MS)
    assert device.read(0).status is DeviceStatus.ARMED
    goal = home_position()
    goal[LAYOUT.arm("right")] += 0.2
    assert device.write(RobotCommand(1, Mode.POSITION, goal, LAYOUT.torque), 0)
    clock.sleep_until_ns(110 * MS)
    assert device.read(0).status is DeviceStatus.ARMED
    clock.sleep_until_ns(113 * MS)
    state = device.read(0)
    assert state.status is DeviceStatus.FAULT and "watchdog" in state.fault
    assert not device.write(RobotCommand(2, Mode.POSITION, goal, LAYOUT.torque), 0)
    clock.sleep_until_ns(1000 * MS)
    held = device.read(0)
    assert np.abs(held.velocity).max() < 0.01
    device.arm(0)
    assert device.write(RobotCommand(3, Mode.POSITION, held.position, LAYOUT.torque), 0)


def test_a_command_that_is_not_finite_is_refused() -> None:
    simulation = Simulation(DRAWN.drawn(0))
    device = MujocoDevice(simulation)
    device.open()
    device.arm(0)
    bad = home_position()
    bad[3] = np.nan
    assert not device.write(RobotCommand(1, Mode.POSITION, bad, LAYOUT.torque), 0)
    assert not device.write(RobotCommand(1, Mode.POSITION, home_position(), bad), 0)
    assert device.write(RobotCommand(1, Mode.POSITION, home_position(), LAYOUT.torque), 0)


def test_lockstep_perception_sees_the_box_where_it_is() -> None:
    clean = PerceptionSection(noise_m=0.0, noise_deg=0.0, bias_m=0.0, bias_deg=0.0)
    world = open_lockstep(Scenario(name="seen", perception=clean).drawn(1))
    assert world.perception.object_pose(0) is None
    world.clock.sleep_until_ns(200 * MS)
    sample = world.perception.object_pose(world.clock.now_ns())
    assert sample is not None and world.clock.now_ns() - sample.stamp_ns <= 60 * MS
    assert np.allclose(sample.X_world_box, world.simulation.X_world_box, atol=1e-4)
    image = world.perception.image(world.clock.now_ns())
    camera, p = image.model, sample.X_world_box[:3, 3]
    x, y, z = np.linalg.inv(camera.X_world_camera)[:3] @ [*p, 1.0]
    column, row = camera.width / 2 + camera.focal_px * x / z, camera.height / 2 + camera.focal_px * y / z
    assert image.pixels.shape == (camera.height, camera.width)
    assert image.pixels[round(row), round(column)] > 0


def test_the_commanded_palm_follows_the_commands_and_not_what_pushes_the_arm() -> None:
    simulation = Simulation(DRAWN.drawn(0))
    palm = CommandedPalm(simulation.model, simulation.drives, "right")
    body = simulation.model.body("right_palm").id
    simulation.step(200)
    at_rest = palm.pose()
    np.testing.assert_allclose(at_rest[:3, 3], simulation.data.xpos[body], atol=1e-3)
    simulation.data.xfrc_applied[body, 1] = 20.0
    simulation.step(300)
    np.testing.assert_array_equal(palm.pose(), at_rest)
    assert np.linalg.norm(simulation.data.xpos[body] - at_rest[:3, 3]) > 1e-3
    simulation.data.xfrc_applied[body] = 0.0
    goal = home_position()
    goal[LAYOUT.arm("right")] += 0.05
    simulation.drives.follow(goal, LAYOUT.torque, 0.3)
    simulation.step(600)
    assert np.linalg.norm(palm.pose()[:3, 3] - at_rest[:3, 3]) > 0.02
    np.testing.assert_allclose(palm.pose()[:3, 3], simulation.data.xpos[body], atol=1e-3)
