"""When drives take up commands that arrive unevenly: at even distances, as modules synchronised to their bus do."""

from __future__ import annotations

DELAY_STEPS = 1
"""How long the first command after a pause waits where its sender's time is not the plant's, steps."""


class CommandCadence:
    """Decides step by step whether the newest command that waits is taken.

    Drives interpolate from target to target within one command period. Taken as they arrive, commands whose sender
    needs now 0.7 and now 1.2 ms would be 1, 2 or 3 steps apart, and the targets' speed would ripple by half.
    Laws: commands that arrive within `delay_steps` after an even distance are taken at exactly that distance; one
    that arrives later is taken at once, and puts off those after it, so that the next ones may be as late as it was.
    """

    def __init__(self, period_steps: int, delay_steps: int = DELAY_STEPS) -> None:
        """Expect a command every `period_steps`, and let the first one after a pause wait for `delay_steps`.

        Raises:
            ValueError: the period is less than one step, or the delay negative.
        """
        if period_steps < 1:
            raise ValueError(f"period_steps: got {period_steps}, allowed is >= 1")
        if delay_steps < 0:
            raise ValueError(f"delay_steps: got {delay_steps}, allowed is >= 0")
        self._period, self._delay = period_steps, delay_steps
        self._due: int | None = None

    def reset(self) -> None:
        """Treat the next command as the first."""
        self._due = None

    def takes(self, step: int, waiting: bool) -> bool:
        """Return whether to take the waiting command in this step; call it once a step, `step` counts up."""
        if not waiting:
            return False
        if self._due is None or step > self._due + self._period:
            self._due = step + self._delay
        if step < self._due:
            return False
        self._due = step + self._period
        return True
