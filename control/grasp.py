"""The torque-limited grasp of one hand as a state machine: close, tighten, hold, open (paper, end of section IV).

Fingers move along internal-force directions: each driven joint turns by dq = k (tau_goal - tau) dt, cut to a
speed. A finger that meets the object first waits there until its opponents have met it too, so that the
object is not dragged. Holding keeps the torques by slow integration on the position, which stays stiff for
what is fast. A joint whose torque sensor says nothing new is led by what its drive may use: it pushes with that torque
and no more, and has met the object when it stays behind its target.
"""

from __future__ import annotations

from enum import Enum

import numpy as np

from preshape.control.grip import Grip, Stage
from preshape.control.opposition import opposition, press
from preshape.control.touch import Flags, TouchSense
from preshape.hal.layout import HAND_DOF, LAYOUT
from preshape.hal.state import Vector

TIGHTENING_GAIN = 0.5
"""Joint speed per missing torque while tightening, rad/s/(N m).

Drive and contact together are some 17 N m/rad stiff: with this the torque grows with a time constant of 0.1 s. Three
times as much is as fast as `TORQUE_FILTER_S` and overshoots by 30 %.
"""
TORQUE_FILTER_S = 0.030
"""Time constant of the torque that is acted on, s."""
CLOSING_SPEED = 0.35
"""Largest joint speed before contact, rad/s."""
TIGHTENING_SPEED = 0.5
OPENING_SPEED = 1.2
"""Largest joint speeds after contact and while opening, rad/s."""
MET = 0.85
"""Share of its goal at which a torque counts as met."""
MOST_TRAVEL = 0.75
"""A driven joint that has turned this far without touching has missed, rad."""
LET_GO_RAD = 0.03
"""The driven joints count as open from here, rad."""
BEHIND_RAD = 0.06
"""A joint without a torque sensor that stays this far behind its target has met something, rad."""
SENSELESS_NM = 0.2
"""A joint whose sensor says nothing may use its goal's torque, and this much at least, N m.

Until all have met the object it may use no more than this: enough to move, too little to push the object away.
"""
STALE_S = 0.05
"""Samples older than this are not integrated on."""


class GraspStatus(Enum):
    """Where a grasp is; the text is what is reported."""

    OPEN = "open"
    CLOSING = "closing"
    HOLDING = "holding"
    OPENING = "opening"
    MISSED = "missed"
    SLIPPED = "slipped"

    @property
    def failed(self) -> bool:
        """Whether this is a way out that is not success."""
        return self in (GraspStatus.MISSED, GraspStatus.SLIPPED)


class Grasp:
    """One hand's grasp from preshape to release; `step` once a tick."""

    def __init__(self, grip: Grip, fingers: Vector) -> None:
        """Start open, with the fingers asked to stay at these angles (13), rad."""
        self.grip = grip
        self.status = GraspStatus.OPEN
        self.reason = ""
        self._target = np.asarray(fingers, float).copy()
        self._start = self._target.copy()
        hand = LAYOUT.hand(grip.side)
        self._lower, self._upper, self._torque_limit = LAYOUT.lower[hand], LAYOUT.upper[hand], LAYOUT.torque[hand]
        self._goal = np.nan_to_num(grip.torques)
        self._driven = np.isfinite(grip.torques)
        self._opposed = opposition(grip.opposed, self._goal)
        at_most = np.where(self._driven, np.maximum(np.abs(self._goal), SENSELESS_NM), np.inf)
        self._senseless_limit = np.minimum(self._torque_limit, at_most)
        self._touch = TouchSense()
        self._stage = -1
        self._elapsed = 0.0
        self._stage_start = self._target.copy()
        self._creep = np.zeros(HAND_DOF)
        self._share = 1.0
        self._filtered = np.zeros(HAND_DOF)
        self._behind = np.zeros(HAND_DOF, dtype=np.bool_)

    def close(self) -> None:
        """Begin closing, from the angles asked for last."""
        self.status, self._stage, self._elapsed = GraspStatus.CLOSING, 0, 0.0
        self._stage_start = self._start = self._target.copy()
        self._touch.reset()

    def ease(self, share: float) -> None:
        """Hold with a share of the torque goals from now on, as when another hand comes to help."""
        self._share = share

    def open(self) -> None:
        """Begin opening to the grip's preshape."""
        self.status = GraspStatus.OPENING

    def step(self, dt: float, position: Vector, torque: Vector, age_s: float) -> tuple[Vector, Vector]:
        """Return the angles (13), rad, and torque limits (13), N m, to ask for in this tick."""
        self._touch.update(torque)
        self._filtered += min(1.0, dt / TORQUE_FILTER_S) * (torque - self._filtered)
        torque = self._filtered
        usable = ~self._touch.frozen & (age_s < STALE_S)
        self._behind = self._touch.frozen & (np.abs(self._target - position) > BEHIND_RAD)
        if self.status is GraspStatus.CLOSING:
            self._close_on(dt, torque, usable)
        elif self.status is GraspStatus.HOLDING:
            self._keep(dt, torque, usable)
        elif self.status is GraspStatus.OPENING:
            self._let_go(dt)
        return self._target.copy(), self._limits(usable)

    def _close_on(self, dt: float, torque: Vector, usable: Flags) -> None:
        stage = self.grip.stages[self._stage]
        self._elapsed += dt
        share = min(1.0, self._elapsed / stage.seconds) if np.isfinite(stage.angles).any() else 1.0
        placed = np.isfinite(stage.angles)
        self._target[placed] = (self._stage_start + share * (stage.angles - self._stage_start))[placed]
        driven = np.isfinite(stage.torques)
        if stage.touch:
            self._meet(dt, stage, driven)
        else:
            self._drive(dt, torque, stage.torques, driven & usable)
            self._push(dt, stage.torques, driven & self._touch.frozen & ~self._behind)
        if self._stage_done(stage, driven, torque):
            self._next_stage()

    def _meet(self, dt: float, stage: Stage, driven: Flags) -> None:
        """Turn every driven joint that has not touched yet towards the object; those that have, wait."""
        going = driven & ~self._met_object
        self._push(dt, stage.torques, going)
        missed = going & (np.abs(self._target - self._start) > MOST_TRAVEL)
        if missed.any() or (self._elapsed > stage.seconds and going.any()):
            self.status = GraspStatus.MISSED
            self.reason = "has closed without meeting the box"

    @property
    def _met_object(self) -> Flags:
        """The joints that have met the object, by their torque or, without a sensor, by staying behind."""
        return self._touch.touching | self._behind

    def _push(self, dt: float, goal: Vector, joints: Flags) -> None:
        step = np.sign(np.nan_to_num(goal)) * CLOSING_SPEED * dt
        self._target[joints] = np.clip(self._target + step, self._lower, self._upper)[joints]

    def _drive(self, dt: float, torque: Vector, goal: Vector, joints: Flags) -> None:
        missing = np.nan_to_num(goal) - torque
        step = np.clip(TIGHTENING_GAIN * missing, -TIGHTENING_SPEED, TIGHTENING_SPEED) * dt
        self._target[joints] = np.clip(self._target + step, self._lower, self._upper)[joints]

    def _stage_done(self, stage: Stage, driven: Flags, torque: Vector) -> bool:
        if stage.touch:
            return bool(self._met_object[driven].all())
        if np.isfinite(stage.angles).any() and self._elapsed < stage.seconds:
            return False
        told = np.where(self._touch.frozen, self._behind, np.abs(torque) >= MET * np.abs(stage.torques))
        met = told[driven]
        return bool(met.all()) or self._elapsed >= stage.seconds

    def _next_stage(self) -> None:
        self._stage += 1
        self._elapsed = 0.0
        self._stage_start = self._target.copy()
        if self._stage == len(self.grip.stages):
            self.status = GraspStatus.HOLDING
            self._creep = self._target.copy()

    def _keep(self, dt: float, torque: Vector, usable: Flags) -> None:
        goal = self._goal * self._share
        press(self._opposed, goal, torque, usable, dt, self._lower, self._upper, self._target)
        crept = np.abs(self._target - self._creep)[self._driven]
        if (crept > MOST_TRAVEL).any():
            self.status = GraspStatus.SLIPPED
            self.reason = "has closed further than a held box allows"

    def _let_go(self, dt: float) -> None:
        """Open the driven joints first: what only lies around the object then leaves it without rubbing along."""
        left = self.grip.preshape - self._target
        driven = self._driven
        going = driven if np.abs(left[driven]).max() > LET_GO_RAD else np.ones(HAND_DOF, dtype=np.bool_)
        self._target += np.where(going, np.clip(left, -OPENING_SPEED * dt, OPENING_SPEED * dt), 0.0)
        if np.abs(left).max() < 1e-3:
            self.status = GraspStatus.OPEN

    def _limits(self, usable: Flags) -> Vector:
        """Return the torque limits; a joint whose sensor says nothing may not use more than its goal."""
        senseless = self._senseless_limit
        if self.status is GraspStatus.CLOSING and self.grip.stages[self._stage].touch:
            senseless = np.where(self._driven, np.minimum(senseless, SENSELESS_NM), senseless)
        return np.where(usable, self._torque_limit, senseless)
