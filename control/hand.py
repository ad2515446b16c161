"""One hand within the procedure: its grasp law, run every tick, and motions that wait for its states."""

from __future__ import annotations

import numpy as np

from preshape.control.body import Body
from preshape.control.failure import TaskFailed
from preshape.control.grasp import Grasp, GraspStatus
from preshape.control.grip import Grip
from preshape.control.motions import Motion, ticks
from preshape.hal.layout import LAYOUT, Side

CLOSE_S = 8.0
"""Longest time a closing may take, s."""
OPEN_S = 4.0
"""Longest time an opening may take, s."""


class Hand:
    """The grasp of one hand; while it is active it alone says where the fingers go."""

    def __init__(self, side: Side, body: Body) -> None:
        """Start without a grasp."""
        self.side: Side = side
        self._body = body
        self._grasp: Grasp | None = None

    def update(self) -> None:
        """Run the grasp law for this tick, if there is one."""
        if self._grasp is None:
            return
        body, hand = self._body, LAYOUT.hand(self.side)
        target, limit = self._grasp.step(
            body.period_s, body.position[hand], body.torque[hand],
            float(np.max(body.age_ns[hand])) * 1e-9,
        )  # fmt: skip
        body.ask_fingers(self.side, target, limit)

    def close(self, grip: Grip) -> Motion:
        """Close on what lies between the fingers until it is held; `TaskFailed` if nothing is."""
        self._grasp = Grasp(grip, self._body.asked_fingers(self.side))
        self._grasp.close()
        for _ in range(ticks(self._body, CLOSE_S)):
            if self._grasp.status is GraspStatus.HOLDING:
                return
            self._fail_if_lost()
            yield
        raise TaskFailed(f"timed out: the {self.side} hand did not close within {CLOSE_S:g} s")

    def ease(self, share: float) -> None:
        """Hold with a share of the grip's torques."""
        if self._grasp is not None:
            self._grasp.ease(share)

    def open(self) -> Motion:
        """Open to the grip's preshape and end the grasp."""
        if self._grasp is None:
            return
        self._grasp.open()
        for _ in range(ticks(self._body, OPEN_S)):
            if self._grasp.status is GraspStatus.OPEN:
                break
            yield
        self._grasp = None

    def check(self) -> None:
        """Raise `TaskFailed` if a hand that should hold does not."""
        if self._grasp is not None:
            self._fail_if_lost()

    def _fail_if_lost(self) -> None:
        grasp = self._grasp
        if grasp is not None and grasp.status.failed:
            raise TaskFailed(f"{grasp.status.value}: the {self.side} hand {grasp.reason}")
