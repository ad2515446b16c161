"""The paced world: the device laws across processes, perception, the verdict, clean ends."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from typing import ClassVar

import numpy as np
import pytest
from device_conformance import DeviceConformance, Rig

from preshape.hal.device import DeviceUnreachable
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand
from preshape.sim_backend.paced import PacedWorld
from preshape.sim_backend.scenario import ObstacleSection, PerceptionSection, Scenario
from preshape.sim_backend.simulation import home_position

CLEAN = PerceptionSection(noise_m=0.0, noise_deg=0.0, bias_m=0.0, bias_deg=0.0)
NEAR = ObstacleSection(name="late", size_m=(0.1, 0.1, 0.1), position_m=(0.9, 0.5, 0.6), appears_s=0.1)
SCENARIO = Scenario(name="paced", perception=CLEAN, obstacles=(NEAR,)).drawn(0)
PATIENT = 200
"""Watchdog cycles for machines that stall: these tests are not about time."""

pytestmark = pytest.mark.physics


@pytest.fixture
def world() -> Iterator[PacedWorld]:
    with PacedWorld(SCENARIO, PATIENT) as opened:
        yield opened


class TestPacedDevice(DeviceConformance):
    """The simulated joint modules in a process of their own; one world serves all laws."""

    readable_when_closed = True
    freshest_s = 0.2
    world: ClassVar[PacedWorld]

    @pytest.fixture(autouse=True, scope="class")
    @classmethod
    def one_world(cls) -> Iterator[None]:
        with PacedWorld(SCENARIO, PATIENT) as opened:
            cls.world = opened
            yield

    def open_rig(self) -> Rig:
        rig = Rig(self.world.device, self.world.clock)
        rig.device.open()
        rig.arm()
        rig.drive(home_position(), 0.3)
        rig.device.close()
        return Rig(self.world.device, self.world.clock)


def test_perception_sees_the_box_and_the_obstacle(world: PacedWorld) -> None:
    world.clock.sleep_until_ns(world.clock.now_ns() + 300_000_000)
    sample = world.perception.object_pose(world.clock.now_ns())
    assert sample is not None
    assert np.allclose(sample.X_world_box[:3, 3], [0.55, -0.30, 0.10], atol=1e-3)
    assert 0 < world.clock.now_ns() - sample.stamp_ns < 1_000_000_000
    assert [obstacle.name for obstacle in world.perception.obstacles(0)] == ["obstacle_late"]
    image = world.perception.image(world.clock.now_ns())
    assert image.pixels.any() and not image.pixels.all()
    assert image.stamp_ns <= world.clock.now_ns()


def test_the_verdict_comes_back_at_the_end(world: PacedWorld) -> None:
    world.referee.report_opening("+x", "+y", 0.0, np.eye(4))
    world.clock.sleep_until_ns(world.clock.now_ns() + 50_000_000)
    finished = world.finish()
    assert finished.verdict.opening_error is not None and finished.verdict.opening_error[0] > 0.1
    assert not finished.verdict.success and finished.verdict.undesired_contacts == ()
    assert finished.simulated_s > 0.0 and finished.slipped_s >= 0.0
    world.device.close()
    assert not world.device.write(_command(), 0)


def test_a_dead_physics_process_is_unreachable_and_closing_still_ends(world: PacedWorld) -> None:
    physics = next(child for child in world._children if child.name == "physics")
    assert physics.pid is not None
    os.kill(physics.pid, signal.SIGKILL)
    physics.join()
    with pytest.raises(DeviceUnreachable, match="physics process"):
        world.device.arm(0)
    world.device.stop("gone", 0)
    with pytest.raises(DeviceUnreachable):
        world.finish()
    world.close()
    assert not any(child.is_alive() for child in world._children)


def test_a_slow_world_and_its_clock_go_at_one_pace() -> None:
    with PacedWorld(SCENARIO, PATIENT, pace=0.25) as world:
        world.device.open()
        machine_ns, first_ns = time.monotonic_ns(), world.device.read(world.clock.now_ns()).stamp_ns.max()
        world.clock.sleep_until_ns(world.clock.now_ns() + 100_000_000)
        machine_s = (time.monotonic_ns() - machine_ns) * 1e-9
        last_ns = world.device.read(world.clock.now_ns()).stamp_ns.max()
        assert machine_s > 0.4
        # What the machine's stalls take from the scene is not made up for.
        assert 0.0 < (last_ns - first_ns) * 1e-9 < 0.25 * machine_s + 0.02
        assert abs(world.clock.now_ns() - last_ns) < 200_000_000


def test_the_module_watchdog_runs_in_the_physics_process() -> None:
    with PacedWorld(SCENARIO, 5) as world:
        world.device.open()
        world.device.arm(world.clock.now_ns())
        assert world.device.write(_command(), world.clock.now_ns())
        world.clock.sleep_until_ns(world.clock.now_ns() + 300_000_000)
        state = world.device.read(world.clock.now_ns())
        assert state.status is DeviceStatus.FAULT and "watchdog" in state.fault
        assert not world.device.write(_command(2), world.clock.now_ns())


def _command(sequence: int = 1) -> RobotCommand:
    return RobotCommand(sequence, Mode.POSITION, home_position(), LAYOUT.torque)
