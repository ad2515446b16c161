"""A python-can bus whose frames somebody else is told of, in both directions."""

from __future__ import annotations

from collections.abc import Callable

import can

Tap = Callable[[can.Message, bool], None]
"""Is told of a frame that has passed, and whether it was received; it must neither wait nor change the frame."""


class TappedBus(can.BusABC):
    """One end of a bus; what fails here fails as on the bus itself, and is not told."""

    def __init__(self, bus: can.BusABC, tap: Tap, echoes: bool = False) -> None:
        """Take over an open bus; if it `echoes`, what is sent is told when it comes back, and not twice."""
        super().__init__(channel=bus.channel_info)
        self.channel_info = bus.channel_info
        self._can_protocol = bus.protocol
        self._bus, self._tap, self._echoes = bus, tap, echoes

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame."""
        self._bus.send(msg, timeout)
        if not self._echoes:
            self._tap(msg, False)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame, None if there is none in time."""
        message = self._bus.recv(timeout)
        if message is not None:
            self._tap(message, True)
        return message

    def shutdown(self) -> None:
        """Give the bus back; may be called twice."""
        super().shutdown()
        self._bus.shutdown()
