"""Ctrl-C and requests to terminate as braked stops of a loop."""

from __future__ import annotations

import signal
import threading
from contextlib import AbstractContextManager
from types import FrameType
from typing import TYPE_CHECKING

from preshape.control.loop import ControlLoop

if TYPE_CHECKING:
    from signal import _HANDLER as Handler  # pyright: ignore[reportPrivateUsage]

STOPPED_BY = {signal.SIGINT: "interrupted from the keyboard", signal.SIGTERM: "asked to terminate"}
"""Signals that ask for a braked stop, and what is then given as its reason."""


class StopSignals(AbstractContextManager["StopSignals"]):
    """Until it is left, the first signal asks a loop for a braked stop; the second one ends the program.

    It outlives the loop: a signal that comes when the loop has ended must not cost the run its report.
    """

    def __init__(self) -> None:
        """Change nothing yet: before there is a loop, a signal ends the program."""
        self._before: dict[signal.Signals, Handler] = {}
        self._loop: ControlLoop | None = None

    def obey(self, loop: ControlLoop) -> None:
        """From now on stop `loop` on a signal."""
        self._loop = loop
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._stop) for number in STOPPED_BY}

    def __exit__(self, *raised: object) -> None:
        """Handle signals as before."""
        before, self._before = self._before, {}
        for number, handler in before.items():
            signal.signal(number, handler)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self.__exit__()
        if self._loop is not None:
            self._loop.request_stop(STOPPED_BY[signal.Signals(number)])
