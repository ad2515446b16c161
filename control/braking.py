"""The motion of a stop that somebody has asked for: every joint to rest in ruckig's least time."""

from __future__ import annotations

import numpy as np

from preshape.control.smoothing import SmoothConfig, Smoother
from preshape.hal.gate import SafetyGate
from preshape.hal.layout import LAYOUT
from preshape.hal.state import Vector


class Braking:
    """Continues what a gate has put out, and brings it to rest within the limits of jerk that commands keep as well.

    It asks no controller: a stop must work beside one that does not. The gate judges its commands like any others,
    and brakes by itself where the robot's state does not allow even this (`SafetyGate.check`).
    """

    def __init__(self, gate: SafetyGate) -> None:
        """Make ready to brake; nothing moves by it."""
        self._gate = gate
        self._smoother = Smoother(SmoothConfig(period_s=gate.config.period_s))
        self._step_before = np.zeros(LAYOUT.dof)

    def note(self) -> None:
        """Take note of the gate's output, once a tick before its next check: two steps tell the acceleration."""
        np.copyto(self._step_before, self._gate.step)

    def begin(self) -> None:
        """Brake from the gate's output on; again, when the gate has let through something else than was asked for."""
        period_s = self._gate.config.period_s
        velocity = self._gate.step / period_s
        self._smoother.seed(self._gate.position, velocity, (self._gate.step - self._step_before) / period_s**2)

    def step(self) -> Vector:
        """Return the positions (40,), rad, to ask the gate for in this tick."""
        return self._smoother.brake().position
