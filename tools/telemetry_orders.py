"""Orders on their way from the telemetry process to the loop: a few words of shared memory, looked at every tick."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from multiprocessing.context import SpawnContext

import numpy as np
from numpy.typing import NDArray

from preshape.hal.tick_record import TickRecord, as_bytes

ORDERS = np.dtype(
    [
        ("stop", np.int64),
        ("arm", np.int64),
        ("start", np.int64),
        ("until_task", np.int64),
        ("waiting", np.int64),
        ("stop_reason", "S80"),
    ]
)
"""How often each was ordered; `until_task` is 0 when no goal was given. `waiting` is the loop's own word: whether it
waits for a start."""

OrdersMemory = ctypes.Array[ctypes.c_char]


def orders_memory(context: SpawnContext) -> OrdersMemory:
    """Return zeroed memory for orders, to be handed to a child process."""
    return context.RawArray("c", ORDERS.itemsize)


class Orders:
    """Both sides' view: each field is one word with one writer; a reason is written before the word that counts."""

    def __init__(self, memory: OrdersMemory) -> None:
        """Look at memory made by `orders_memory`."""
        self._words: NDArray[np.void] = np.frombuffer(memoryview(memory), ORDERS, 1)
        self._stop: NDArray[np.int64] = self._words["stop"]

    def order_stop(self, reason: str) -> None:
        """Order a stop; the first reason stays."""
        if not self._stop[0]:
            self._words["stop_reason"] = as_bytes(reason)
        self._stop[0] += 1

    @property
    def stopped(self) -> bool:
        """Whether a stop has been ordered."""
        return bool(self._stop[0])

    @property
    def stop_reason(self) -> str:
        """Why a stop has been ordered."""
        return bytes(self._words["stop_reason"][0]).decode("ascii")

    def order(self, name: str, value: int = 1) -> None:
        """Order `arm` or `start`, or give a goal by `until_task`."""
        self._words[name] = value

    def ordered(self, name: str) -> int:
        """Return what `order` has been told of this name, 0 if nothing."""
        return int(self._words[name][0])


class OrdersWatch:
    """An observer that hands a stop on to the loop in the tick after it came."""

    def __init__(self, orders: Orders, request_stop: Callable[[str], None]) -> None:
        """Call `request_stop` (`ControlLoop.request_stop`) once."""
        self._orders, self._request_stop = orders, request_stop
        self._told = False

    def notify(self, record: TickRecord) -> None:
        """Look whether a stop has been ordered."""
        if not self._told and self._orders.stopped:
            self._told = True
            self._request_stop(self._orders.stop_reason)
