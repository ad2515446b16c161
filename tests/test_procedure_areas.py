"""Grips are taken from what the procedure's areas leave, and from nothing else."""

from __future__ import annotations

from itertools import product

import pytest

from preshape.control.failure import TaskFailed
from preshape.control.grips import brace_grip, cage_grip
from preshape.control.procedure_areas import components_left, finger_face, lies_in, palm_face, procedure_areas, realizes
from preshape.hal.world import Face, NominalBox, Opening, opposite
from preshape.sim_backend.scene import nominal_box
from preshape.tools.configuration import load_scenario

ENDS: tuple[Face, Face] = ("+z", "-z")
SIDES: tuple[Face, Face] = ("+y", "-y")


@pytest.fixture(scope="module")
def box() -> NominalBox:
    return nominal_box(load_scenario("tea_box").drawn(0))


def test_what_the_right_hand_may_take_first_are_the_twelve_components_of_the_papers_area(box: NominalBox) -> None:
    assert len(components_left(box, None, {}, "right", 1)) == 12


@pytest.mark.parametrize(("end", "fingers"), list(product(ENDS, SIDES)))
def test_every_cage_of_an_end_is_one_of_them_and_leaves_a_brace_of_the_other_end_for_every_opening(
    box: NominalBox, end: Face, fingers: Face
) -> None:
    cage = cage_grip(box.size, end, fingers, "right")
    assert (palm_face(cage), finger_face(cage)) == (end, fingers)
    assert lies_in(cage, components_left(box, None, {}, "right", 1))
    for face, edge in product(box.candidate_faces, SIDES):
        opening = Opening(face=face, edge=edge, offset=0.0)
        brace = brace_grip(box.size, opposite(end), face, "left")
        left = components_left(box, opening, {"right": cage}, "left", 3)
        assert lies_in(brace, left)


def test_the_end_that_the_right_hand_has_is_not_left_to_the_other_one(box: NominalBox) -> None:
    cage = cage_grip(box.size, "+z", "+y", "right")
    opening = Opening(face="+x", edge="+y", offset=0.0)
    same_end = brace_grip(box.size, "+z", "+x", "left")
    left = components_left(box, opening, {"right": cage}, "left", 3)
    assert left and not lies_in(same_end, left)


def test_a_grip_that_was_taken_counts_as_the_one_chosen(box: NominalBox) -> None:
    cage = cage_grip(box.size, "-z", "-y", "right")
    area = procedure_areas(box, None, {"right": cage}).at("r", 1)
    assert area is not None and area.chosen is not None and realizes(cage, area.chosen)


def test_a_hand_without_a_grasp_in_a_task_has_nothing_left_and_says_so(box: NominalBox) -> None:
    with pytest.raises(TaskFailed, match="no area for the left hand in task 1"):
        components_left(box, None, {}, "left", 1)
