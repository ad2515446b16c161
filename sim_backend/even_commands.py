"""The broadcasts of one group as its modules take them in real time: the newest, at even distances."""

from __future__ import annotations

from preshape.sim_backend.command_cadence import CommandCadence


class EvenCommands:
    """Holds the newest broadcast until it is time; see `CommandCadence`. An older one that still waits is lost."""

    def __init__(self) -> None:
        self._waiting: bytes | bytearray | None = None
        self._cadence = CommandCadence(1)
        self._period = 1

    def put(self, payload: bytes | bytearray) -> None:
        """Take a broadcast that has arrived."""
        self._waiting = payload

    def due(self, step: int, period: int) -> bytes | bytearray | None:
        """Return the broadcast to be taken in this step, if any; call it once a step. `period`: steps in a cycle."""
        if period != self._period:
            self._cadence, self._period = CommandCadence(period), period
        if not self._cadence.takes(step, self._waiting is not None):
            return None
        payload, self._waiting = self._waiting, None
        return payload
