"""What is on virtual buses, told to whoever listens and written down in a log that python-can reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import can

Listener = Callable[[can.Message], None]
"""Is told of a frame, with the bus' name as its channel and the time it was sent at as its stamp, s."""


class BusTap:
    """Listens on virtual buses and tells listeners of every frame, in the order in which it was sent on its bus."""

    def __init__(self, channels: Mapping[str, str], now_ns: Callable[[], int], listeners: Sequence[Listener]) -> None:
        """Listen on virtual `channels` by bus name; `now_ns` is the time that frames are stamped with."""
        self._taps = {
            name: can.Bus(interface="virtual", channel=channel, protocol=can.CanProtocol.CAN_FD)
            for name, channel in channels.items()
        }
        self._now_ns, self._listeners = now_ns, tuple(listeners)

    def pump(self, time_ns: int) -> None:
        """Tell what has been sent since the last call."""
        for name, tap in self._taps.items():
            while (message := tap.recv(0.0)) is not None:
                message.timestamp, message.channel = self._now_ns() * 1e-9, name
                for listener in self._listeners:
                    listener(message)

    def close(self) -> None:
        """Tell what is left and go."""
        self.pump(0)
        for tap in self._taps.values():
            tap.shutdown()


class BusLog:
    """A listener that writes frames to a file, in the format of candump."""

    def __init__(self, file: Path) -> None:
        """Begin the file anew."""
        self._writer = can.CanutilsLogWriter(file)

    def write(self, message: can.Message) -> None:
        """Write one frame."""
        self._writer.on_message_received(message)

    def flush(self) -> None:
        """Have everything in the file that was written so far."""
        self._writer.file.flush()

    def close(self) -> None:
        """Close the file."""
        self._writer.stop()
