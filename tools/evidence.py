"""What is kept of a run, tick by tick, to draw it afterwards: records for plots, snapshots for the storyboard."""

from __future__ import annotations

from collections.abc import Callable

from preshape.hal.state import Vector
from preshape.hal.tick_record import TickRecord, text_of
from preshape.tools.plan_drawing import PlanDrawing
from preshape.tools.storyboard import StoryboardRecorder
from preshape.tools.tick_buffer import TickBuffer


class StoryboardObserver:
    """Feeds a storyboard from the loop; times count from the first tick."""

    def __init__(self, positions: Callable[[], Vector]) -> None:
        """Take the scene's positions (nq,) from `positions`."""
        self.recorder = StoryboardRecorder()
        self._positions = positions
        self._start_ns: int | None = None

    def notify(self, record: TickRecord) -> None:
        """Take note of one tick."""
        now_ns = int(record["now_ns"])
        if self._start_ns is None:
            self._start_ns = now_ns
        task, phase = int(record["task"]), text_of(record, "phase")
        if task:
            self.recorder.feed((now_ns - self._start_ns) * 1e-9, task, phase, self._positions())


class Evidence:
    """The observers of one run that keep something, and what its plan looked like; any may be missing."""

    def __init__(self) -> None:
        """Keep nothing yet."""
        self.ticks: TickBuffer | None = None
        self.storyboard: StoryboardObserver | None = None
        self.plan: PlanDrawing | None = None

    def keep_ticks(self) -> TickBuffer:
        """Return the observer for the plots."""
        self.ticks = TickBuffer()
        return self.ticks

    def keep_pictures(self, positions: Callable[[], Vector]) -> StoryboardObserver:
        """Return the observer for the storyboard."""
        self.storyboard = StoryboardObserver(positions)
        return self.storyboard
