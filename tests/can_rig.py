"""A driver and simulated modules on virtual buses, in lockstep with the robot alone: what the bus tests stand on."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from random import Random

import can
from device_conformance import Rig

from preshape.hal.can.bus_address import BusAddress, open_bus
from preshape.hal.can.device import CanDevice
from preshape.hal.can.device_config import CanDeviceConfig
from preshape.hal.can.topology import TOPOLOGY, BusSpec, Topology
from preshape.sim_backend.bare_robot import BareRobot
from preshape.sim_backend.lockstep import SimClock
from preshape.sim_backend.module_rack import ModuleRack

_NUMBERS = itertools.count()

Wrap = Callable[[can.BusABC, str], can.BusABC]
"""Puts something between the driver and one of its buses, by name."""


class CanRig(Rig):
    """A `Rig` whose modules, plant and channels can be reached; `tap` opens one more listener on a bus."""

    def __init__(self, topology: Topology = TOPOLOGY, wrap: Wrap | None = None, seed: int = 0,
                 config: CanDeviceConfig | None = None) -> None:  # fmt: skip
        number = next(_NUMBERS)
        self.topology, self.wrap = topology, wrap
        self.channels = {spec.name: f"test-{number}-{spec.name}" for spec in topology.buses}
        self.robot = BareRobot(seed)
        buses = {spec.name: self.module_bus(spec) for spec in topology.buses}
        self.rack = ModuleRack(topology, self.robot, buses, seed, reply_s=0.0015)
        self._random = Random(seed)
        device = CanDevice(topology, self.open_bus, config, lambda: self._random.getrandbits(32))
        super().__init__(device, SimClock(self.robot))
        self.can = device

    def address(self, name: str) -> BusAddress:
        """Return where a bus is."""
        return BusAddress("virtual", self.channels[name])

    def module_bus(self, spec: BusSpec) -> can.BusABC:
        """Open the modules' end of a bus."""
        return open_bus(self.address(spec.name), spec.profile)

    def open_bus(self, spec: BusSpec, identifiers: list[int]) -> can.BusABC:
        bus = open_bus(self.address(spec.name), spec.profile, identifiers)
        return bus if self.wrap is None else self.wrap(bus, spec.name)

    def tap(self, name: str = "right_hand") -> can.BusABC:
        return can.Bus(interface="virtual", channel=self.channels[name], protocol=can.CanProtocol.CAN_FD)

    def ready(self) -> CanRig:
        """Open the driver and arm."""
        self.device.open()
        self.wait(0.02)
        self.arm()
        return self

    def close(self) -> None:
        self.device.close()
        self.rack.close()


class VcanRig(CanRig):
    """Driver and modules in lockstep, over one vcan of the kernel for each bus."""

    def address(self, name: str) -> BusAddress:
        return BusAddress("socketcan", f"vcan{list(self.channels).index(name)}")
