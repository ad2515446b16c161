"""What is on the buses, written down: one log that python-can reads, with the time of the plant as stamps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import can


class BusLog:
    """Listens on virtual buses and writes every frame, in the order in which it was sent, on channels by bus name."""

    def __init__(self, file: Path, channels: Mapping[str, str], now_ns: Callable[[], int]) -> None:
        """Listen on virtual `channels` by bus name; `now_ns` is the time that frames are stamped with."""
        self._writer = can.CanutilsLogWriter(file)
        self._taps = {
            name: can.Bus(interface="virtual", channel=channel, protocol=can.CanProtocol.CAN_FD)
            for name, channel in channels.items()
        }
        self._now_ns = now_ns

    def pump(self, time_ns: int) -> None:
        """Write what has been sent since the last call."""
        for name, tap in self._taps.items():
            while (message := tap.recv(0.0)) is not None:
                message.timestamp, message.channel = self._now_ns() * 1e-9, name
                self._writer.on_message_received(message)

    def close(self) -> None:
        """Write what is left and close the file."""
        self.pump(0)
        for tap in self._taps.values():
            tap.shutdown()
        self._writer.stop()
