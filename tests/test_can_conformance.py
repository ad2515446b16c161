"""The conformance suite on the CAN driver: over virtual buses, with and without FD."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from can_rig import CanRig
from device_conformance import DeviceConformance, Rig

from preshape.hal.can.device_config import CanDeviceConfig
from preshape.hal.can.topology import robot_topology


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
