"""A driver that a test kills while its buses are written down: a child imports this file."""

from __future__ import annotations

import time
from pathlib import Path

import can

from preshape.tools.bus_recorder import BusRecorder

BUSES = ("right_hand", "left_hand")


def drive(file: str, channel: str) -> None:
    """Send a frame each millisecond until killed."""
    recorder = BusRecorder(Path(file), BUSES)
    bus = recorder.over(BUSES[0], can.Bus(interface="virtual", channel=channel))
    for number in range(10**6):
        bus.send(can.Message(arbitration_id=number % 2000, is_extended_id=False, data=number.to_bytes(4, "big")))
        time.sleep(0.001)
