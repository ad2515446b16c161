"""The predicates of the lift procedure on true events: taken from the table by the right hand alone, then held."""

from __future__ import annotations

from preshape.sim_backend.contact_scan import LEFT_ON_BOX, OTHER_ON_BOX, RIGHT_ON_BOX, TABLE_ON_BOX
from preshape.sim_backend.stages import LIFT_M, Glance, Stages

HELD_S = 1.0
"""How long the right hand alone must keep the object up."""
_ANYONE = RIGHT_ON_BOX | LEFT_ON_BOX | TABLE_ON_BOX | OTHER_ON_BOX


class LiftStages(Stages):
    """Walks from stage 1 to 3: T1 as in the paper's procedure, T2 without a break for `HELD_S`."""

    def walk(self, glance: Glance) -> None:
        """Take one step."""
        up = glance.bits & _ANYONE == RIGHT_ON_BOX and glance.lowest >= LIFT_M
        if self.stage == 1 and up:
            self.reach("T1", 2, glance.seconds)
        if self.stage == 2 and self.lasts("held", up, glance.seconds, HELD_S):
            self.reach("T2", 3, glance.seconds)
