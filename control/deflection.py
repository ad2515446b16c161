"""How the field takes a hand off a motion that is given, and lets it come back (paper, section IV, task 5).

The motions that push and open are given. On top of them the hand has an offset that the field drives: what the
contact policy lets repel pushes it, the stated attraction pulls it back to nothing,

    d(offset)/dt = mobility (f_repulsion + f_attraction(-offset)),

palm and finger joints alike. Before the thumb has met the opening the palm gives way to whatever comes near to palm
and fingers; afterwards only the fingers' joints do. What the given motion itself comes near to does not repel: each
group's range against each body is

    r = min(range, 0.9 (c - s) + e / 2),    0 where c <= s,

with c the distance that the group keeps from that body at both ends of the leg, e how far the hand is from its way, and
s = epsilon log n by how much the soft minimum of n boxes may lie below their least distance (0 for hard ties).
"""

from __future__ import annotations

import numpy as np

from preshape.control.approach import ApproachLimits, FieldGuide
from preshape.control.body import Body
from preshape.control.contact_policy import Phase, apply_policy
from preshape.control.field import HandError, HandGoal, hand_error
from preshape.control.goal_clearance import SHARE, SLOPE, goal_clearance, goal_error
from preshape.control.groups import GROUPS, PART_GROUPS
from preshape.control.motions import limited
from preshape.control.obstacles import MAX_BODIES
from preshape.hal.layout import HAND_DOF, LAYOUT, SIDES, Side
from preshape.hal.transform import exp_so3, transform

READ_TICKS = 10
"""The field is read for telemetry once in so many ticks."""


class Deflection:
    """The offset of one hand from its given motion."""

    def __init__(self, guide: FieldGuide, body: Body, side: Side) -> None:
        """Start on the motion."""
        self._guide, self._body = guide, body
        self._side: Side = side
        self._limits = ApproachLimits()
        self._p, self._w, self._joints = np.zeros(3), np.zeros(3), np.zeros(HAND_DOF)
        field = guide.field
        sizes = np.bincount(PART_GROUPS, minlength=len(GROUPS))
        softness = field.parameters.tie_m if field.options.ties == "smooth" else 0.0
        self._below = softness * np.log(sizes)[:, None]
        self._reached = np.full((len(GROUPS), MAX_BODIES), np.inf)
        self._clearance = self._reached
        self._tick = 0

    def head_for(self, goal: HandGoal) -> None:
        """Take the end of the next leg, which begins where the last one ends."""
        self._guide.refresh()
        clearance = goal_clearance(self._guide.field, self._side, goal) - self._below
        self._clearance, self._reached = np.minimum(self._reached, clearance), clearance

    def applied(self, way: HandGoal, phase: Phase) -> HandGoal:
        """Return where the palm and the joints shall be, given where the motion has them; once a tick."""
        guide, body, side = self._guide, self._body, self._side
        hand = LAYOUT.hand(side)
        guide.refresh()
        apply_policy(guide.field.gains, guide.obstacles, side, phase)
        off = goal_error(hand_error(way, body.palm(side), body.position[hand]))
        near = np.minimum(guide.field.parameters.range_m, SHARE * self._clearance + SLOPE * off)
        guide.field.gains.reach[SIDES.index(side)] = np.where(self._clearance > 0.0, near, 0.0)
        guide.field.evaluate()
        if self._tick % READ_TICKS == 0:
            guide.read()
        self._tick += 1
        self._drift()
        X = way.X_world_palm
        return HandGoal(
            transform(X[:3, 3] + self._p, exp_so3(self._w) @ X[:3, :3]),
            np.clip(way.joints + self._joints, LAYOUT.lower[hand], LAYOUT.upper[hand]),
        )

    def _drift(self) -> None:
        """Move the offset by one period."""
        field, limits, dt = self._guide.field, self._limits, self._body.period_s
        push, pull = field.repulsion(self._side), field.attraction(HandError(-self._p, -self._w, -self._joints))
        twist, joints = push.twist + pull.twist, push.joints + pull.joints
        self._p += dt * limited(twist[:3], limits.speed)
        self._w += dt * limited(twist[3:], limits.turn_speed)
        self._joints += dt * np.clip(joints, -limits.joint_speed, limits.joint_speed)
