"""The simulated modules in a process of their own, on multicast buses: what tests of real time stand on."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Generator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

import can

from preshape.hal.can.bus_address import BusAddress, bus_addresses, open_bus
from preshape.hal.can.device import CanDevice
from preshape.hal.can.device_config import CanDeviceConfig
from preshape.hal.can.topology import TOPOLOGY, BusSpec
from preshape.sim_backend.bus_joints import BusWiring
from preshape.sim_backend.hand_bus import serve_robot

PATIENT = 200
"""Cycles of patience for machines that stall: most tests are not about time."""


def multicast_addresses() -> dict[str, BusAddress]:
    """Return ports of this process' own, so that tests may run side by side."""
    base = 20_000 + os.getpid() % 40_000
    return bus_addresses(TOPOLOGY, "udp_multicast", [f"239.74.163.7:{base}"])


def _serve(wiring: BusWiring, line: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    serve_robot(0, wiring, lambda: line.send("ready"), line.poll)


@contextmanager
def served_modules(addresses: dict[str, BusAddress], patience: int = PATIENT) -> Generator[BaseProcess]:
    """Run the modules before the bare robot until the context is left."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    child = context.Process(target=_serve, args=(BusWiring(TOPOLOGY, addresses, patience), there), daemon=True)
    child.start()
    there.close()
    try:
        assert here.poll(60.0), "the modules did not come up"
        assert here.recv() == "ready"
        yield child
    finally:
        if child.is_alive():
            here.send("end")
        child.join(10.0)
        child.kill()


def multicast_driver(addresses: dict[str, BusAddress], patience: int = PATIENT) -> CanDevice:
    """Return a driver of the modules at these addresses."""

    def open_one(spec: BusSpec, identifiers: list[int]) -> can.BusABC:
        return open_bus(addresses[spec.name], spec.profile, identifiers)

    return CanDevice(TOPOLOGY, open_one, CanDeviceConfig(lost_cycles=patience))
