"""Physics, joint modules and controller in one process, in turns, with virtual CAN buses between: deterministic."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

import can

from preshape.hal.can.await_modules import await_modules
from preshape.hal.can.bus_address import bus_addresses, open_bus
from preshape.hal.can.device import CanDevice
from preshape.hal.can.device_config import CanDeviceConfig
from preshape.hal.can.topology import TOPOLOGY, BusSpec, Topology
from preshape.hal.state import Vector
from preshape.sim_backend.bus_log import BusLog, BusTap, Listener
from preshape.sim_backend.kicks import KickSchedule
from preshape.sim_backend.lockstep import LockstepWorld, SimClock
from preshape.sim_backend.module_rack import ModuleRack
from preshape.sim_backend.referee import Referee
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene_perception import attach_sensors
from preshape.sim_backend.simulation import Simulation

REPLY_S = 0.0015
"""A module reports so long after a broadcast: its frames arrive just before the next tick, as fresh as can be."""
START_S = 1.0
"""Longest simulated time until every module has answered, s."""

_WORLDS = itertools.count()
"""Virtual buses are found by name in the whole process: every world gets names of its own."""

Wrap = Callable[[can.BusABC, str, SimClock], can.BusABC]
"""Puts something between an end of a bus and the bus, given its name and the world's clock."""


@dataclass(frozen=True, slots=True, eq=False)
class CanLockstepWorld:
    """A lockstep world whose `world.device` is the CAN `driver`; `rack` holds the modules behind the buses."""

    world: LockstepWorld
    driver: CanDevice
    rack: ModuleRack
    tap: BusTap | None
    log: BusLog | None

    def close(self) -> None:
        """Close driver, modules and log."""
        self.driver.close()
        self.rack.close()
        for listening in (self.tap, self.log):
            if listening is not None:
                listening.close()


def open_can_lockstep(
    scenario: Scenario,
    config: CanDeviceConfig | None = None,
    topology: Topology = TOPOLOGY,
    log: Path | None = None,
    home: Vector | None = None,
    host_side: Wrap | None = None,
    module_side: Wrap | None = None,
    listeners: Sequence[Listener] = (),
) -> CanLockstepWorld:
    """Return the world of a drawn scenario with the device open and every module heard.

    Frames are written to the file `log` and told to `listeners`; `host_side` wraps the driver's ends of the buses,
    `module_side` the modules'.

    Raises:
        DeviceUnreachable: a module did not answer.
    """
    simulation = Simulation(scenario, home=home)
    referee = Referee(simulation)
    clock = SimClock(simulation)
    addresses = bus_addresses(topology, "virtual", [f"lockstep-{next(_WORLDS)}"])
    buses = {spec.name: open_bus(addresses[spec.name], spec.profile) for spec in topology.buses}
    if module_side is not None:
        buses = {name: module_side(bus, name, clock) for name, bus in buses.items()}
    rack = ModuleRack(topology, simulation, buses, scenario.seed, REPLY_S)
    if config is not None:
        for module in rack.modules.values():
            module.parameters.watchdog_cycles = config.lost_cycles
    written = None if log is None else BusLog(log)
    told = [*listeners, *([] if written is None else [written.write])]
    tap = _listen({name: address.channel for name, address in addresses.items()}, simulation, told) if told else None
    random = Random(f"{scenario.seed} host")

    def host_bus(spec: BusSpec, identifiers: list[int]) -> can.BusABC:
        bus = open_bus(addresses[spec.name], spec.profile, identifiers)
        return bus if host_side is None else host_side(bus, spec.name, clock)

    driver = CanDevice(topology, host_bus, config, lambda: random.getrandbits(32))
    sensors, kicks = attach_sensors(simulation), KickSchedule(simulation, referee)
    lockstep = LockstepWorld(simulation, driver, clock, sensors, referee, kicks)
    world = CanLockstepWorld(lockstep, driver, rack, tap, written)
    try:
        driver.open()
        await_modules(driver, clock, START_S)
    except BaseException:
        world.close()
        raise
    return world


def _listen(channels: dict[str, str], simulation: Simulation, listeners: Sequence[Listener]) -> BusTap:
    tap = BusTap(channels, lambda: simulation.time_ns, listeners)
    simulation.before_step.append(tap.pump)
    simulation.after_step.append(tap.pump)
    return tap
