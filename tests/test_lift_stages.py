"""The predicates of the lift on scripted events, without physics."""

from __future__ import annotations

from dataclasses import replace

import pytest

from preshape.sim_backend.contact_rules import ALLOWED, CLASS, LIFT_RULES, contact_table
from preshape.sim_backend.contact_scan import LEFT_ON_BOX, OTHER_ON_BOX, RIGHT_ON_BOX, TABLE_ON_BOX
from preshape.sim_backend.judged import judged
from preshape.sim_backend.lift_stages import HELD_S, LiftStages
from preshape.sim_backend.stages import Glance, Stages

IDLE = Glance(0.0, 0, 0.0, False, 0.0, 0.0, False)


class Script:
    """Feeds stages with glances, 1 ms apart."""

    def __init__(self) -> None:
        self.stages, self.seconds = LiftStages(), 0.0

    def show(self, seconds: float, bits: int, lowest: float) -> int:
        for _ in range(max(1, round(seconds * 1000))):
            self.seconds += 0.001
            self.stages.update(replace(IDLE, seconds=self.seconds, bits=bits, lowest=lowest))
        return self.stages.stage


@pytest.mark.parametrize("also", [LEFT_ON_BOX, TABLE_ON_BOX, OTHER_ON_BOX])
def test_only_the_right_hand_alone_lifts_and_holds(also: int) -> None:
    script = Script()
    assert script.show(2.0, RIGHT_ON_BOX | also, 0.1) == 1
    assert script.show(2.0, RIGHT_ON_BOX, 0.049) == 1
    assert script.show(0.001, RIGHT_ON_BOX, 0.05) == 2 and script.stages.done(1)
    assert script.show(2.0, RIGHT_ON_BOX | also, 0.1) == 2 and not script.stages.done(2)


def test_the_hold_must_last_without_a_break() -> None:
    script = Script()
    script.show(HELD_S - 0.01, RIGHT_ON_BOX, 0.1)
    assert script.show(0.001, RIGHT_ON_BOX, 0.04) == 2
    assert script.show(HELD_S - 0.01, RIGHT_ON_BOX, 0.1) == 2
    assert script.show(0.02, RIGHT_ON_BOX, 0.1) == 3
    assert script.stages.done(1) and script.stages.done(2)


def test_the_right_hand_may_touch_throughout_the_table_until_the_lift_the_left_hand_never() -> None:
    table = contact_table(LIFT_RULES)
    for stage in (1, 2, 3):
        row = table[stage, CLASS["shell"]]
        assert row[CLASS["right_thumb"]] == row[CLASS["right_palm"]] == ALLOWED
        assert (row[CLASS["table"]] == ALLOWED) == (stage == 1)
        assert row[CLASS["left_thumb"]] != ALLOWED and row[CLASS["right_arm"]] != ALLOWED


def test_a_box_is_judged_by_the_opening_anything_else_by_the_lift() -> None:
    assert list(judged("box").names.values()) == ["grasp", "inspect", "regrasp", "crush", "open"]
    assert type(judged("box").stages()) is Stages
    for shape in ("l_carton", "cylinder"):
        assert list(judged(shape).names.values()) == ["grasp", "hold"]  # type: ignore[arg-type]
        assert type(judged(shape).stages()) is LiftStages  # type: ignore[arg-type]
