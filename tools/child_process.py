"""Processes of their own that a run starts and ends: waiting until one is up, and until one is done."""

from __future__ import annotations

import time
from multiprocessing.process import BaseProcess
from multiprocessing.synchronize import Event

from preshape.hal.device import DeviceUnreachable

READY_S = 60.0
"""Longest time until a process is up, s."""
_LOOK_S = 0.1


def start(process: BaseProcess, ready: Event) -> None:
    """Start a process and wait until it says that it is ready.

    Raises:
        DeviceUnreachable: it has ended before, or is not within `READY_S`; the message has the process's name.
    """
    process.start()
    deadline_s = time.monotonic() + READY_S
    while not ready.wait(_LOOK_S):
        if not process.is_alive() or time.monotonic() > deadline_s:
            raise DeviceUnreachable(f"{process.name} process: did not come up")


def await_end(process: BaseProcess, within_s: float) -> None:
    """Wait until a started process has ended by itself; kill it after so long, s. May be called twice."""
    process.join(within_s)
    if process.is_alive():
        process.kill()
        process.join()
