"""The table of allowed contacts, walked whole."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from preshape.sim_backend.contact_rules import ALLOWED, CLASS, CLASSES, SELF, contact_table, geom_classes, hand
from preshape.sim_backend.scenario import ObstacleSection, Scenario
from preshape.sim_backend.scene import build_scene

TABLE = contact_table()
BOX = ("shell", "rim", "lid", "tab")
OBSTACLE = ObstacleSection(name="o", size_m=(0.1, 0.1, 0.1), position_m=(0.5, 0.5, 0.5))


def expected(stage: int, a: str, b: str) -> bool:
    """Say in words what the table says as data."""
    if a in BOX:
        a, b = b, a
    if b not in BOX:
        return False
    if a == "table":
        return stage <= 2
    if a in hand("left"):
        return stage >= 3
    if a in hand("right"):
        if stage <= 3 or a == "right_thumb":
            return True
        return stage >= 5 and a in ("right_fore", "right_middle") and b != "shell"
    return False


@pytest.mark.parametrize("stage", range(1, 7))
def test_every_pair_is_as_the_rules_say(stage: int) -> None:
    for a, b in product(CLASSES, CLASSES):
        entry = TABLE[stage, CLASS[a], CLASS[b]]
        own_hand = any(a in hand(side) and b in hand(side) for side in ("right", "left"))
        assert (entry == SELF) == own_hand
        assert (entry == ALLOWED) == (expected(stage, a, b) and not (a in BOX and b in BOX)), (stage, a, b)


def test_table_is_symmetric() -> None:
    assert np.array_equal(TABLE, TABLE.transpose(0, 2, 1))


def test_every_geom_of_a_scene_has_its_class() -> None:
    model = build_scene(Scenario(name="classes", obstacles=(OBSTACLE,)))
    found = {model.geom(g).name: CLASSES[c] for g, c in enumerate(geom_classes(model))}
    assert found["table"] == "table" and found["obstacle_o"] == "obstacle"
    assert found["right_thumb_opp"] == "right_thumb" and found["left_fore_base"] == "left_fore"
    assert found["left_arm_link3"] == "left_arm" and found["lid_low"] == "lid" and found["box_-z"] == "shell"
    counts = {name: sum(c == name for c in found.values()) for name in CLASSES}
    assert counts["right_palm"] == 1 and counts["right_thumb"] == 5 and counts["left_ring"] == 4
    assert counts["shell"] == 5 and counts["lid"] == 3 and counts["tab"] == 1
