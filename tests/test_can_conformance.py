"""The conformance suite on the CAN driver: over virtual buses, with and without FD, and across processes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import pytest
from bus_processes import multicast_addresses, multicast_driver, served_modules
from can_rig import CanRig
from device_conformance import DeviceConformance, Rig

from preshape.hal.can.await_modules import await_modules
from preshape.hal.can.bus_address import BusAddress
from preshape.hal.can.device_config import CanDeviceConfig
from preshape.hal.can.topology import robot_topology
from preshape.hal.clock import MonotonicClock
from preshape.sim_backend.simulation import home_position


class TestCanDeviceOnVirtual(DeviceConformance):
    """Three CAN FD buses, twelve modules, the robot alone behind them."""

    readable_when_closed = True
    rigs: list[CanRig]

    @pytest.fixture(autouse=True)
    def closed_rigs(self) -> Iterator[None]:
        self.rigs = []
        yield
        for rig in self.rigs:
            rig.close()

    def open_rig(self) -> Rig:
        self.rigs.append(CanRig())
        return self.rigs[-1]


class TestCanDeviceOnClassicBuses(TestCanDeviceOnVirtual):
    """The same protocol cut into classic frames."""

    def open_rig(self) -> Rig:
        self.rigs.append(CanRig(robot_topology("classic"), config=CanDeviceConfig()))
        return self.rigs[-1]


@pytest.mark.physics
@pytest.mark.bus
class TestCanDeviceOnMulticast(DeviceConformance):
    """Modules in another process, frames over the network stack, real time; one process serves all laws."""

    readable_when_closed = True
    freshest_s = 0.2
    addresses: ClassVar[dict[str, BusAddress]]

    @pytest.fixture(autouse=True, scope="class")
    @classmethod
    def one_process(cls) -> Iterator[None]:
        cls.addresses = multicast_addresses()
        with served_modules(cls.addresses):
            yield

    def open_rig(self) -> Rig:
        driver = multicast_driver(self.addresses)
        rig = Rig(driver, MonotonicClock())
        driver.open()
        await_modules(driver, rig.clock, 20.0)
        rig.arm()
        rig.drive(home_position(), 0.3)
        rig.device.close()
        return Rig(multicast_driver(self.addresses), MonotonicClock())
