"""A client of a served device that a test kills in the middle of a motion: a child imports this file."""

from __future__ import annotations

import time

import numpy as np
from served_device import ROOT

from preshape.hal.layout import LAYOUT
from preshape.hal.remote_device import RemoteDevice
from preshape.hal.remote_line import RemoteLine
from preshape.hal.state import DeviceStatus, Mode, RobotCommand
from preshape.tools.zenoh_session import client_settings, open_session


def drive_until_killed(endpoint: str) -> None:
    """Arm the device and bend its fingers without end."""
    with open_session(client_settings(endpoint)) as session:
        device = RemoteDevice(RemoteLine(session, ROOT))
        device.open()
        device.arm(time.monotonic_ns())
        while device.read(time.monotonic_ns()).status is not DeviceStatus.ARMED:
            time.sleep(0.002)
        start = device.read(time.monotonic_ns()).position
        for sequence in range(1, 10**9):
            goal = start + 0.2 * (1.0 - np.cos(0.01 * sequence)) * np.arange(LAYOUT.dof).astype(bool)
            goal = np.clip(goal, LAYOUT.lower, LAYOUT.upper)
            device.write(RobotCommand(sequence, Mode.POSITION, goal, LAYOUT.torque), time.monotonic_ns())
            time.sleep(0.002)
