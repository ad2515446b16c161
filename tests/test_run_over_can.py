"""Runs over virtual buses: the same seed puts the same frames on them at the same times."""

from __future__ import annotations

from pathlib import Path

import pytest
from bus_processes import multicast_addresses

from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand
from preshape.sim_backend.scenario import Scenario
from preshape.tools.configuration import load_scenario
from preshape.tools.run_options import RunOptions
from preshape.tools.run_world import open_world
from preshape.tools.session import run_session


def log_of(seed: int, file: Path) -> list[str]:
    """Run for a second on virtual buses; return the log's lines."""
    options = RunOptions(device="can", time_limit_s=1.0, record=False, pictures=False)
    result = run_session(Scenario(name="bus"), seed, options, bus_log=file)
    assert result.report.loop.refused == 0
    return file.read_text().splitlines()


@pytest.mark.physics
@pytest.mark.bus
def test_the_same_seed_gives_the_same_frames_at_the_same_times_and_another_seed_others(tmp_path: Path) -> None:
    first, again = log_of(3, tmp_path / "first.log"), log_of(3, tmp_path / "again.log")
    assert len(first) > 500 * (4 + 12)
    assert first == again
    assert log_of(4, tmp_path / "other.log") != first


@pytest.mark.physics
@pytest.mark.bus
def test_a_run_in_real_time_starts_modules_that_wait_for_its_commands() -> None:
    # 20 Hz: what is tested is that modules and driver are patient, on a machine that other tests keep busy.
    channel = (multicast_addresses()["arms"].channel,)
    options = RunOptions(device="can", paced=True, channel=channel, rate_hz=20)
    with open_world(load_scenario("tea_box").drawn(0), options) as world:
        now, wait = world.clock.now_ns, world.clock.sleep_until_ns
        world.device.arm(now())
        state = world.device.read(now())
        while state.status is DeviceStatus.DISARMED:
            wait(now() + 10_000_000)
            state = world.device.read(now())
        start = state.position
        for number in range(10):
            assert world.device.write(RobotCommand(number, Mode.POSITION, start, LAYOUT.torque), now()), state.fault
            wait(now() + 50_000_000)
            state = world.device.read(now())
    assert (state.status, state.fault, state.sequence >= 8) == (DeviceStatus.ARMED, "", True)
