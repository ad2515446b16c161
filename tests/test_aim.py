"""Laws of what a hand is on its way to, as observers are told."""

from __future__ import annotations

import numpy as np

from preshape.control.aim import grasp_aim, note_aims, tips_of
from preshape.control.grips import cage_grip
from preshape.hal.tick_record import new_record
from preshape.hal.transform import exp_so3, transform
from preshape.hal.world import NominalBox

BOX = NominalBox(np.array([0.06, 0.09, 0.20]), ("+x", "-x"))


def test_the_preshaping_box_is_that_of_the_section_at_the_end_cap_in_the_palm() -> None:
    grip = cage_grip(BOX.size, "+z", "+y", "right")
    goal = grasp_aim("right", grip.X_box_palm, grip.preshape, BOX).preshaping_box
    assert goal is not None
    assert (goal.palm_face, goal.finger_face, goal.thumb_face) == ("+z", "+y", "-y")
    top = goal.X_object_pb[2, 3] + goal.half[2]
    assert np.isclose(top, BOX.size[2] / 2) and goal.X_object_pb[2, 3] - goal.half[2] > BOX.size[2] / 6 - 1e-9


def test_aims_move_with_the_object() -> None:
    grip, record = cage_grip(BOX.size, "+z", "+y", "right"), new_record()
    X_world_box = transform((0.4, -0.3, 0.2), exp_so3(np.array([0.3, -0.2, 1.0])))
    note_aims(record, {"right": grasp_aim("right", grip.X_box_palm, grip.preshape, BOX)}, X_world_box)
    assert np.allclose(record["tip_target"][0], tips_of("right", X_world_box @ grip.X_box_palm, grip.preshape))
    assert np.isnan(record["tip_target"][1]).all() and np.isnan(record["X_world_preshape"][1]).all()


def test_nothing_is_aimed_at_before_the_object_is_seen() -> None:
    grip, record = cage_grip(BOX.size, "+z", "+y", "right"), new_record()
    aims = {"right": grasp_aim("right", grip.X_box_palm, grip.preshape, BOX)}
    note_aims(record, aims, np.eye(4))
    note_aims(record, aims, None)
    assert np.isnan(record["tip_target"]).all() and np.isnan(record["preshape_half"]).all()
