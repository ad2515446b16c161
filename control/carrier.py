"""The holding hand that goes on moving while the other one comes: to and fro at a steady speed, then softly home."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preshape.control.body import Body
from preshape.hal.layout import Side
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, exp_so3, inverse, log_so3, transform

HOME_S = 1e-4
"""The box is home when it is this far from where it set out, s at full speed."""
SWEEP = (0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0)
"""Places of one whole sweep, shares of the way to an end."""
OFFSET_FILTER_S = 0.3
"""Time constant of the correction of the commanded pose by the seen one, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CarryOptions:
    """How the held box moves while the other hand comes, and whether that hand is told.

    Attributes:
        speed: of the box's centre, m/s, along world z.
        turn_speed: about world z through the box's centre, rad/s.
        span_s: time of one sweep at full speed.
        ramp_s: time in which a sweep gathers speed, and in which the motion stops.
        feed_forward: whether the commanded twist is fed forward to the hand that comes.
    """

    speed: float = 0.0
    turn_speed: float = 0.0
    span_s: float = 1.6
    ramp_s: float = 0.4
    feed_forward: bool = True

    def __post_init__(self) -> None:
        for name, most in (("speed", 0.2), ("turn_speed", 1.0)):
            value = getattr(self, name)
            if not 0.0 <= value <= most:
                raise ValueError(f"{name}: got {value:g}, allowed is 0 .. {most:g}")

    @property
    def moves(self) -> bool:
        """Whether the box moves at all."""
        return self.speed > 0.0 or self.turn_speed > 0.0


def sweep(X_world_box: Matrix, options: CarryOptions) -> list[Matrix]:
    """Return poses of the box along one whole sweep from home: to one end of its span, to the other, and home."""
    most = options.span_s / 2 + options.ramp_s / 4
    return [_placed(X_world_box, share * most, options) for share in SWEEP]


def _placed(X_world_home: Matrix, place: float, options: CarryOptions) -> Matrix:
    """Return the box's pose at a place, s at full speed from home."""
    up = np.array([0.0, 0.0, 1.0])
    X = X_world_home.copy()
    X[:3, 3] += place * options.speed * up
    X[:3, :3] = exp_so3(place * options.turn_speed * up) @ X[:3, :3]
    return X


class Carrier:
    """Leads the holding palm; `step` once a tick. At rest it costs nothing and says nothing."""

    def __init__(self, body: Body, side: Side, X_palm_box: Matrix, options: CarryOptions) -> None:
        """Start at the pose asked for now."""
        self._body, self._options = body, options
        self._side: Side = side
        self._X_palm_box = X_palm_box
        self._X_start: Matrix = body.asked_palm(side) @ X_palm_box
        self._place = 0.0
        self._rate = 0.0
        self._direction = 1.0
        self._stopping = not options.moves
        self._offset = np.zeros(6)

    @property
    def stopped(self) -> bool:
        """Whether the box is commanded to stand still."""
        return self._stopping and self._rate == 0.0

    def stop(self) -> None:
        """Go back to where the motion set out and stop there softly: the hand-over was planned there."""
        self._stopping = True

    def step(self, X_world_box_seen: Matrix) -> None:
        """Lead the palm one period on; compare the commanded pose with where the box is seen now.

        The share of full speed is ramped, and turns round at the ends of the span.
        """
        self._compare(X_world_box_seen)
        if self.stopped:
            return
        options, dt = self._options, self._body.period_s
        if self._place * self._direction > options.span_s / 2 - options.ramp_s / 2:
            self._direction = -self._direction
        wanted = self._homing_rate() if self._stopping else self._direction
        change = dt / options.ramp_s
        self._rate += float(np.clip(wanted - self._rate, -change, change))
        self._place += self._rate * dt
        if self._stopping and abs(self._place) < HOME_S and abs(self._rate) < 2.0 * np.sqrt(HOME_S):
            self._place = self._rate = 0.0
        self._body.ask_palm(self._side, self.X_world_box @ inverse(self._X_palm_box))

    def _homing_rate(self) -> float:
        """Return the share of full speed at which half the ramp's deceleration ends at home: v^2 = 2 (1 / 2 T) s."""
        return -float(np.sign(self._place) * min(1.0, np.sqrt(abs(self._place) / self._options.ramp_s)))

    def _compare(self, X_world_box_seen: Matrix) -> None:
        """Low-pass how far the box is off its command, the arm's lag taken out: what is seen is noisy."""
        lag = self._body.asked_palm(self._side) @ inverse(self._body.palm(self._side))
        off = inverse(self.X_world_box) @ lag @ X_world_box_seen
        offset = np.concatenate([off[:3, 3], log_so3(off[:3, :3])])
        self._offset += self._body.period_s / OFFSET_FILTER_S * (offset - self._offset)

    @property
    def X_world_box(self) -> Matrix:
        """The box's pose as commanded."""
        return _placed(self._X_start, self._place, self._options)

    @property
    def twist(self) -> Vector | None:
        """The commanded twist (6,) at the box's centre, or None when it stands still or is not fed forward."""
        if self.stopped or not self._options.feed_forward:
            return None
        up = np.array([0.0, 0.0, 1.0])
        return self._rate * np.concatenate([self._options.speed * up, self._options.turn_speed * up])

    def ahead(self, X_world_box_seen: Matrix) -> Matrix:
        """Return where the box is commanded to be, corrected by what is seen of it.

        Both arms follow their commands with the same lag: the hand that comes is led to the commanded pose. Without
        feed-forward it is led to where the box is seen.
        """
        if not self._options.feed_forward:
            return X_world_box_seen
        return self.X_world_box @ transform(self._offset[:3], exp_so3(self._offset[3:]))
