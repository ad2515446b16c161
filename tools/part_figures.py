"""What a device knows of its own parts, its buses, on its way from the loop to other processes."""

from __future__ import annotations

import ctypes
from multiprocessing.context import SpawnContext

import msgspec
import numpy as np

from preshape.sim_backend.shared_block import SharedBlock, shared_bytes

_TEXT = np.dtype([("text", "S16384")])


class PartFigures(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One part: frames so far and a second, share of the time that they take, error frames so far, temperatures.

    `mono_ns` is when it was looked at, on the loop's clock.
    """

    mono_ns: int
    name: str
    status: str
    fault: str
    count: int
    rate_hz: float
    bus_load: float
    bus_errors: int
    temperature_c: dict[str, float]


PartsMemory = ctypes.Array[ctypes.c_char]


def parts_memory(context: SpawnContext) -> PartsMemory:
    """Return memory for the figures of all parts, to be handed to a child process."""
    return shared_bytes(context, _TEXT)


class PartsWriter:
    """The loop's side."""

    def __init__(self, memory: PartsMemory) -> None:
        """Write into memory made by `parts_memory`."""
        self._block = SharedBlock(memory, _TEXT)

    def write(self, figures: list[PartFigures]) -> None:
        """Replace the figures; never waits."""
        self._block.record["text"] = msgspec.json.encode(figures)
        self._block.publish()


class PartsReader:
    """The side of the process that tells of them."""

    def __init__(self, memory: PartsMemory) -> None:
        """Look at memory made by `parts_memory`."""
        self._block, self._version = SharedBlock(memory, _TEXT), 0

    def newest(self) -> list[PartFigures] | None:
        """Return the figures if there are new ones."""
        version = self._block.version
        record = self._block.read() if version != self._version else None
        if record is None:
            return None
        self._version = version
        return msgspec.json.decode(bytes(record["text"][0]), type=list[PartFigures])
