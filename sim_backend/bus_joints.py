"""The joints of a paced scene behind joint modules on CAN buses: whoever is on the bus drives them."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass

from preshape.hal.can.bus_address import BusAddress, open_buses
from preshape.hal.can.topology import Topology
from preshape.sim_backend.command_cadence import DELAY_STEPS
from preshape.sim_backend.module_rack import ModuleRack
from preshape.sim_backend.plant import Plant
from preshape.sim_backend.shared_block import Record


@dataclass(frozen=True, slots=True)
class BusWiring:
    """Which modules hang on which bus, where each bus is, and after how many missed commands a module stops.

    `pace` is how many seconds pass for them and their scene in each of the machine's.
    """

    topology: Topology
    addresses: Mapping[str, BusAddress]
    watchdog_cycles: int = 5
    pace: float = 1.0


class BusJoints:
    """`preshape.sim_backend.paced_physics.Joints` of a `ModuleRack`: the plant's hooks do the work."""

    def __init__(self, plant: Plant, wiring: BusWiring) -> None:
        """Open the buses and switch the modules on, with keys that nobody can foresee. `DeviceUnreachable`."""
        buses = open_buses(wiring.topology, wiring.addresses)
        self.rack = ModuleRack(wiring.topology, plant, buses, secrets.randbits(64), delay_steps=DELAY_STEPS)
        for module in self.rack.modules.values():
            module.parameters.watchdog_cycles = wiring.watchdog_cycles

    def take(self) -> None:
        """Do nothing: the modules take their frames in the plant's own steps."""

    def fill(self, out: Record) -> None:
        """Publish nothing of the joints: it goes over the buses."""

    def answer(self, request: object) -> str | None:
        """Refuse: the joints are asked over the buses."""
        raise TypeError(f"request: got {request!r}, allowed are those to the scene")

    def close(self) -> None:
        """Switch the modules off and give the buses back."""
        self.rack.close()
