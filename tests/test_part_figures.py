"""What the hand bus knows of itself arrives in the telemetry process."""

from __future__ import annotations

import multiprocessing

import pytest
from kinematic_device import KinematicDevice

from preshape.hal.can.device_config import CanDeviceConfig
from preshape.hal.can.topology import robot_topology
from preshape.hal.tick_record import new_record
from preshape.sim_backend.can_lockstep import open_can_lockstep
from preshape.sim_backend.scenario import Scenario
from preshape.tools.part_figures import PartsReader, parts_memory
from preshape.tools.parts_observer import INTERVAL_NS, PartsObserver

SPAWN = multiprocessing.get_context("spawn")


@pytest.mark.bus
def test_every_bus_tells_its_load_its_errors_and_its_modules_temperatures() -> None:
    lockstep = open_can_lockstep(Scenario(name="bus").drawn(0), CanDeviceConfig(), robot_topology("fd"))
    try:
        memory, device, clock = parts_memory(SPAWN), lockstep.world.device, lockstep.world.clock
        observer, reader, record = PartsObserver((memory,), device, 500.0), PartsReader(memory), new_record()
        for tick in range(300):
            clock.sleep_until_ns(tick * 2_000_000)
            device.read(clock.now_ns())
            record["now_ns"] = clock.now_ns()
            observer.notify(record)
        figures = reader.newest()
        assert figures is not None and reader.newest() is None
    finally:
        lockstep.close()
    assert [part.name for part in figures] == [bus.name for bus in device.topology.buses]
    for part in figures:
        # Without commands the modules are polled as often as commands would come.
        assert 0.05 < part.bus_load < 1.0 and part.bus_errors == 0 and part.status == "ACTIVE" and part.count > 100
        bus = next(bus for bus in device.topology.buses if bus.name == part.name)
        assert set(part.temperature_c) == {module.name for module in bus.modules}


def test_a_device_without_parts_tells_nothing() -> None:
    memory = parts_memory(SPAWN)
    observer, record = PartsObserver((memory,), KinematicDevice(), 500.0), new_record()
    record["now_ns"] = 10 * INTERVAL_NS
    observer.notify(record)
    assert PartsReader(memory).newest() is None
