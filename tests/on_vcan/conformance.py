"""The conformance suite on the CAN driver over the kernel's own CAN stack; run where vcan0 .. vcan2 are up."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from can_rig import CanRig, VcanRig
from device_conformance import DeviceConformance, Rig


class TestCanDeviceOnVcan(DeviceConformance):
    """Three buses, twelve modules, the robot alone behind them."""

    readable_when_closed = True
    rigs: list[CanRig]

    @pytest.fixture(autouse=True)
    def closed_rigs(self) -> Iterator[None]:
        self.rigs = []
        yield
        for rig in self.rigs:
            rig.close()

    def open_rig(self) -> Rig:
        self.rigs.append(VcanRig())
        return self.rigs[-1]
