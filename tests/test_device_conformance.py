"""The conformance suite on the kinematic device and on MuJoCo."""

from __future__ import annotations

import pytest
from device_conformance import DeviceConformance, Rig
from kinematic_device import KinematicDevice
from manual_clock import ManualClock

from preshape.sim_backend.device import MujocoDevice
from preshape.sim_backend.lockstep import SimClock
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.simulation import Simulation


class TestKinematicDevice(DeviceConformance):
    """The simplest device there can be."""

    readable_when_closed = True

    def open_rig(self) -> Rig:
        device = KinematicDevice()
        return Rig(device, ManualClock(device.advance))


@pytest.mark.physics
class TestMujocoDevice(DeviceConformance):
    """The simulated joint modules in lockstep with the physics."""

    readable_when_closed = True

    def open_rig(self) -> Rig:
        simulation = Simulation(Scenario(name="conformance").drawn(0))
        return Rig(MujocoDevice(simulation), SimClock(simulation))
