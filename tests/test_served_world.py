"""A world served by another process: what the controller sees of it, and the referee's word at the end."""

from __future__ import annotations

import signal
from dataclasses import replace

import numpy as np
import pytest
from served_device import served
from zenoh_robot import until

from preshape.hal.state import DeviceStatus
from preshape.hal.world import Opening
from preshape.sim_backend.scene import build_scene, initial_box_pose
from preshape.tools.configuration import load_scenario
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.remote_options import RemoteOptions
from preshape.tools.remote_world import open_served_world
from preshape.tools.run_options import RunOptions
from preshape.tools.served_opening import opening_from, opening_to

pytestmark = pytest.mark.physics

OPENING = Opening("+x", "+y", 0.004)


def test_pose_obstacles_image_scene_and_verdict_come_over() -> None:
    drawn = load_scenario("tea_box_obstacle").drawn(3)
    with served("--scenario", "tea_box_obstacle", "--seed", "3") as server:
        options = RunOptions(device="zenoh", remote=RemoteOptions(endpoint=server.endpoint))
        with pytest.raises(ConfigurationError, match="got tea_box 0, served is tea_box_obstacle 3"):
            with open_served_world(load_scenario("tea_box").drawn(0), options):
                raise AssertionError("another world was taken")
        with pytest.raises(ConfigurationError, match="--rate-hz: got 500, served is 250"):
            with open_served_world(drawn, replace(options, rate_hz=500)):
                raise AssertionError("another rate was taken")
        with open_served_world(drawn, options) as world:
            now = world.clock.now_ns
            assert until(lambda: world.perception.object_pose(now()) is not None)
            sample = world.perception.object_pose(now())
            assert sample is not None and 0 < now() - sample.stamp_ns < 1e9
            assert np.linalg.norm(sample.X_world_box[:3, 3] - initial_box_pose(drawn)[:3, 3]) < 0.05
            assert len(world.perception.obstacles(now())) <= len(drawn.obstacles)
            image = world.perception.image(now())
            assert image.pixels.shape == (image.model.height, image.model.width) and image.pixels.std() > 1.0
            assert 0 < now() - image.stamp_ns < 5e9
            assert until(lambda: world._line.newest("scene") is not None)
            assert world.scene_positions().shape == (build_scene(drawn).nq,)
            assert world.device.read(now()).status is DeviceStatus.DISARMED
            world.report_opening(OPENING, sample.X_world_box)
            ended = world.finish()
        assert server.process.wait(30.0) == 0
    assert ended.simulated_s > 0.0 and not ended.verdict.success
    assert ended.verdict.opening_error is not None and ended.verdict.tasks[0].name == "grasp"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_server_that_is_asked_to_end_stops_the_device_and_says_what_torque_there_was(number: signal.Signals) -> None:
    # Programs that a script starts in the background are deaf to Ctrl-C's signal unless they listen themselves.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with served() as server:
            server.signal(number)
            assert server.process.wait(30.0) == 0
            assert server.process.stderr is not None
            said = server.process.stderr.read()
    finally:
        signal.signal(signal.SIGINT, before)
    assert "interrupted: the device has been stopped" in said and "largest torque in physics: 0." in said


def test_an_opening_survives_its_json() -> None:
    X = np.eye(4)
    X[:3, 3] = 0.1, 0.2, 0.3
    found, pose = opening_from(opening_to(OPENING, X))
    assert found == OPENING and np.array_equal(pose, X)
    for wrong in ({}, opening_to(OPENING, X) | {"face": "top"}, opening_to(OPENING, X) | {"X_world_box": [[1.0]]}):
        with pytest.raises(ValueError, match=r"face|X_world_box"):
            opening_from(wrong)
