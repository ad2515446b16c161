"""What is commanded while a controller thinks: the motion of its last setpoints, brought to rest."""

from __future__ import annotations

import numpy as np

from preshape.control.controller import Setpoint
from preshape.control.smoothing import SmoothConfig, Smoother
from preshape.hal.layout import LAYOUT
from preshape.hal.state import Vector


class HeldMotion:
    """Continues the setpoints that it is told of within the limits of jerk, and brakes, in ruckig's least time.

    To repeat the last setpoint would ask moving joints to stand at once: the gate would carry them beyond it, and
    what the controller had computed meanwhile would ask them to jump back.
    """

    def __init__(self, period_s: float) -> None:
        """Start at rest, nowhere: `follow` says where before the first `step`."""
        self._period_s = period_s
        self._smoother = Smoother(SmoothConfig(period_s=period_s))
        self._position: Vector | None = None
        self._velocity, self._acceleration = np.zeros(LAYOUT.dof), np.zeros(LAYOUT.dof)
        self._limit = LAYOUT.torque.copy()
        self._braking = self._diverged = False

    def take_over(self) -> tuple[Vector, Vector] | None:
        """Return the command that the controller has to go on from, once; None when the last was its own setpoint.

        Position (40,), rad, and velocity (40,), rad/s.
        """
        diverged, self._diverged = self._diverged, False
        return (self._known, self._velocity) if diverged else None

    def note(self, setpoint: Setpoint) -> None:
        """Take note of a setpoint of the controller's own; two of them tell the velocity, three the acceleration."""
        before = setpoint.position if self._position is None else self._position
        velocity = (setpoint.position - before) / self._period_s
        self._acceleration = (velocity - self._velocity) / self._period_s
        self._position, self._velocity, self._limit = setpoint.position, velocity, setpoint.torque_limit
        self._braking = False

    def follow(self, position: Vector, velocity: Vector) -> None:
        """Continue from a command that is not the last setpoint."""
        self._position, self._velocity = position.copy(), velocity.copy()
        self._acceleration, self._braking, self._diverged = np.zeros(LAYOUT.dof), False, True

    def step(self) -> Setpoint:
        """Return the setpoint of a tick in which the controller has none."""
        if not self._braking:
            self._smoother.seed(self._known, self._velocity, self._acceleration)
            self._braking = True
        self._diverged = True
        braked = self._smoother.brake()
        self._position, self._velocity = braked.position, braked.velocity
        return Setpoint(braked.position, self._limit)

    @property
    def _known(self) -> Vector:
        if self._position is None:
            raise RuntimeError("held before the first command to follow")
        return self._position
