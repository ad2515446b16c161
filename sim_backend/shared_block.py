"""One record in memory that two processes share: one writes, the other reads whole records or none."""

from __future__ import annotations

import ctypes
import mmap
from multiprocessing.context import SpawnContext
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Record = NDArray[np.void]
Memory = ctypes.Array[ctypes.c_char] | mmap.mmap
"""What two processes see: memory inherited by a child, or a file that both have mapped."""
_ATTEMPTS = 1000


def shared_bytes(context: SpawnContext, dtype: np.dtype[Any]) -> ctypes.Array[ctypes.c_char]:
    """Return zeroed memory for one block of a record type, to be handed to a child process."""
    return context.RawArray("c", 16 + dtype.itemsize)


def file_bytes(path: Path, dtype: np.dtype[Any], create: bool = False) -> mmap.mmap:
    """Return the memory of one block of a record type in a file, made anew and zeroed with `create`."""
    size = 16 + dtype.itemsize
    if create:
        path.write_bytes(bytes(size))
    with path.open("r+b") as file:
        return mmap.mmap(file.fileno(), size)


class SharedBlock:
    """A sequence lock: the counter is odd while the one writer is at work.

    `record` is the writer's own copy, filled field by field and then published whole.
    """

    def __init__(self, memory: Memory, dtype: np.dtype[Any]) -> None:
        """Look at memory made by `shared_bytes` or `file_bytes` for the same record type."""
        self._memory = memory
        self._counter = np.frombuffer(memoryview(memory), np.int64, 1)
        self._shared = np.frombuffer(memoryview(memory), dtype, 1, 16)
        self.record: Record = np.zeros(1, dtype)

    @property
    def version(self) -> int:
        """How many records have been published."""
        return int(self._counter[0]) // 2

    def publish(self) -> None:
        """Make the record visible to the reader."""
        self._counter[0] += 1
        self._shared[:] = self.record
        self._counter[0] += 1

    def read(self) -> Record | None:
        """Return a copy of the newest record, None when the writer was faster in every attempt."""
        for _ in range(_ATTEMPTS):
            before = int(self._counter[0])
            copy = self._shared.copy()
            if before % 2 == 0 and int(self._counter[0]) == before:
                return copy
        return None
