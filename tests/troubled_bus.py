"""An end of a bus that refuses to send when it is told to, in the ways in which python-can reports it."""

from __future__ import annotations

import can


class TroubledBus(can.BusABC):
    """Passes everything on until `refusal` is set: then every send raises it. `sent` counts what has passed."""

    def __init__(self, bus: can.BusABC) -> None:
        super().__init__(channel=bus.channel_info)
        self.channel_info = bus.channel_info
        self.refusal: Exception | None = None
        self.told: list[can.Message] = []
        self.sent = 0
        self._bus = bus

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.refusal is not None:
            raise self.refusal
        self.sent += 1
        self._bus.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self.told:
            return self.told.pop(0), True
        return self._bus.recv(timeout), True

    def tell(self, error_class: int, content: bytes = bytes(8)) -> None:
        """Let the controller read an error frame next."""
        self.told.append(
            can.Message(arbitration_id=error_class, is_error_frame=True, is_extended_id=False, data=content)
        )

    def shutdown(self) -> None:
        super().shutdown()
        self._bus.shutdown()
