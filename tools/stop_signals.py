"""Ctrl-C and requests to terminate as braked stops of a loop."""

from __future__ import annotations

import signal
import threading
from contextlib import AbstractContextManager

from preshape.control.loop import ControlLoop
from preshape.tools.end_signals import EndSignals

STOPPED_BY = {signal.SIGINT: "interrupted from the keyboard", signal.SIGTERM: "asked to terminate"}
"""What is given as a stop's reason."""


class StopSignals(AbstractContextManager["StopSignals"]):
    """Until it is left, the first signal asks a loop for a braked stop; the second one ends the program.

    It outlives the loop: a signal that comes when the loop has ended must not cost the run its report.
    """

    def __init__(self) -> None:
        """Change nothing yet: before there is a loop, a signal ends the program."""
        self._signals: EndSignals | None = None

    def obey(self, loop: ControlLoop) -> None:
        """From now on stop `loop` on a signal."""
        if threading.current_thread() is threading.main_thread():
            self._signals = EndSignals(lambda number: loop.request_stop(STOPPED_BY[number])).__enter__()

    def __exit__(self, *raised: object) -> None:
        """Handle signals as before."""
        if self._signals is not None:
            self._signals.__exit__()
