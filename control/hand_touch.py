"""Which members of a hand have met something: by joint torque against the free hand's, or because they are blocked."""

from __future__ import annotations

import numpy as np

from preshape.control.body import Body
from preshape.control.groups import MEMBERS, Member
from preshape.control.touch import TOUCH_TICKS, Flags, TouchSense, count_over
from preshape.hal.layout import HAND_DOF, LAYOUT, Side, finger_slice

BLOCKED_RAD = 0.10
"""A joint that stays this far behind its command is blocked, rad."""
_JOINTS: dict[Member, slice] = {member: finger_slice(member) for member in MEMBERS if member != "palm"}


class HandTouch:
    """The touch of one hand's fingers, debounced; `update` once a tick."""

    def __init__(self, side: Side, body: Body) -> None:
        """Start untouched; the torques of the first ticks count as those of a free hand."""
        self._body, self._hand = body, LAYOUT.hand(side)
        self._sense = TouchSense()
        self._behind = np.zeros(HAND_DOF, dtype=np.int64)
        self._blocked: Flags = np.zeros(HAND_DOF, dtype=np.bool_)
        self._zero = np.zeros(HAND_DOF)

    def forget(self) -> None:
        """Take the hand to be free now: gravity's torques change with its attitude."""
        self._sense.reset()
        self._behind[:] = 0
        self._blocked[:] = False

    def update(self) -> None:
        """Take this tick's torques, and how far the joints are behind their commands."""
        body, hand = self._body, self._hand
        self._sense.update(body.torque[hand])
        behind = body.commanded[0][hand] - body.position[hand]
        count_over(behind, self._zero, BLOCKED_RAD, TOUCH_TICKS, self._behind, self._blocked)

    def met(self, member: Member) -> bool:
        """Whether a finger has met something since the hand was last taken to be free; the palm has no sensor."""
        joints = _JOINTS.get(member)
        return joints is not None and bool((self._sense.touching[joints] | self._blocked[joints]).any())

    def blind(self, member: Member) -> bool:
        """Whether a finger has a sensor that says nothing new: it may have met something without being felt."""
        joints = _JOINTS.get(member)
        return joints is not None and bool(self._sense.frozen[joints].any())
