"""Areas: the paper's figures, and random procedures and boxes against enumeration, open cells, exhaustive search."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.hal.world import Face, NominalBox, Opening, end_caps, long_faces
from preshape.planner.areas import plan_areas
from preshape.planner.component import Component, components_in
from preshape.planner.procedure import PAPER_PROCEDURE, Block, Procedure, Task
from preshape.planner.region import Region
from preshape.planner.regrasp_search import fewest_regrasps
from preshape.planner.sections import FINGER_WIDTH, split
from preshape.tools.area_check import READINGS, check_case
from preshape.tools.bench_areas import bench_areas
from preshape.tools.random_procedure import random_case

TEA_BOX = NominalBox(np.array([0.06, 0.09, 0.20]), ("+x", "-x"))
TEA_BOXES = [
    NominalBox(np.array(size), faces)
    for size, faces in [((0.06, 0.09, 0.20), ("+x", "-x")), ((0.20, 0.06, 0.09), ("+y", "-y"))]
]


def openings(box: NominalBox) -> list[Opening]:
    """Return an opening on every long face at each of its long edges."""
    faces = long_faces(box.long_axis)
    return [Opening(face, edge, 0.005) for face in faces for edge in faces if edge[1] != face[1]]


def with_candidate(box: NominalBox, face: Face) -> NominalBox:
    return NominalBox(box.size, (face,))


@pytest.mark.parametrize("box", TEA_BOXES)
@pytest.mark.parametrize(("caps_only", "count"), [(True, 4), (False, 12)])
def test_first_grasp_has_two_parts_with_the_papers_components(box: NominalBox, caps_only: bool, count: int) -> None:
    for reading in READINGS:
        areas = plan_areas(PAPER_PROCEDURE, box, reading=reading, palm_on_end_caps_only=caps_only)
        for task in (1, 2, 3):
            area = areas.at("r", task)
            assert area is not None
            assert len(area.region.parts()) == 2
            assert len(area.components) == count
            assert all(component.section in (0, 2) for component in area.components)
        sections = {section for section, _ in area.region}
        assert sections == {0, 2}


@pytest.mark.parametrize("box", TEA_BOXES)
def test_literal_leaves_the_left_hand_the_back_of_the_middle_section_alone(box: NominalBox) -> None:
    for opening in openings(box):
        areas = plan_areas(PAPER_PROCEDURE, with_candidate(box, opening.face), opening, reading="literal")
        area = areas.at("l", 3)
        assert areas.feasible
        assert area is not None
        (component,) = area.components
        assert component.section == 1
        assert component.palm[1] == opening.face[1]
        assert component.palm != opening.face
        assert component.pair[0][1] == opening.edge[1]


def test_literal_names_the_cause_when_hands_may_use_end_caps_only() -> None:
    opening = Opening("+x", "+y", 0.0)
    areas = plan_areas(PAPER_PROCEDURE, TEA_BOX, opening, reading="literal", palm_on_end_caps_only=True)
    cause = areas.certificate
    assert cause is not None
    assert cause.block == Block("l", 3, 5)
    assert cause.palm_on_end_caps_only
    assert "left hand, tasks 3-5" in str(cause)
    assert areas.at("l", 4).chosen is None  # type: ignore[union-attr]


def test_committed_leaves_the_left_hand_the_other_end() -> None:
    for opening in openings(TEA_BOX):
        box = with_candidate(TEA_BOX, opening.face)
        areas = plan_areas(PAPER_PROCEDURE, box, opening, palm_on_end_caps_only=True)
        right, left = areas.at("r", 1), areas.at("l", 3)
        assert right is not None
        assert left is not None
        assert right.chosen is not None
        assert left.chosen is not None
        assert right.chosen.section != left.chosen.section
        assert opening.face not in left.chosen.pair
        assert not left.chosen.patches & right.chosen.patches


def test_search_area_is_the_middle_section() -> None:
    area = plan_areas(PAPER_PROCEDURE, TEA_BOX).at("c", 2)
    assert area is not None
    assert area.region == Region.of(2, [(1, face) for face in long_faces(2)])


def test_components_are_sixteen_with_four_on_caps() -> None:
    for axis in range(3):
        every = components_in(Region.whole(axis))
        assert len(every) == len(set(every)) == 16
        assert sum(c.palm in end_caps(axis) for c in every) == 4
        assert components_in(Region.whole(axis), True) == every[:4]


def test_preshaping_boxes_have_the_thumb_on_either_face() -> None:
    sections = split(TEA_BOX)
    for component in components_in(Region.whole(2)):
        boxes = component.preshaping_boxes(*sections.corners(component.section))
        assert {box.thumb_face for box in boxes} == set(component.pair)
        assert {box.palm_face for box in boxes} == {component.palm}


def test_middle_section_is_a_third_or_the_tab_and_a_finger() -> None:
    assert split(TEA_BOX).cuts == pytest.approx((-0.1 / 3, 0.1 / 3))
    low, high = split(TEA_BOX, Opening("+x", "-y", 0.01)).cuts
    assert (low + high) / 2 == pytest.approx(0.01)
    assert high - low == pytest.approx(TEA_BOX.tab_size[0] + FINGER_WIDTH)


@pytest.mark.parametrize(
    ("size", "faces", "opening", "message"),
    [
        ((0.06, 0.0, 0.20), ("+x",), None, "box size"),
        ((0.06, 0.09, 0.20), ("+z",), None, "candidate_faces"),
        ((0.06, 0.09, 0.20), ("+x",), Opening("-x", "+y", 0.0), "opening.face"),
        ((0.06, 0.09, 0.20), ("+x",), Opening("+x", "+z", 0.0), "opening.edge"),
        ((0.06, 0.09, 0.20), ("+x",), Opening("+x", "-x", 0.0), "opening.edge"),
        ((0.06, 0.09, 0.20), ("+x",), Opening("+x", "+y", 0.09), "opening.offset"),
    ],
)
def test_box_that_cannot_be_split_is_refused_by_field(
    size: tuple[float, ...], faces: tuple[Face, ...], opening: Opening | None, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        plan_areas(PAPER_PROCEDURE, NominalBox(np.array(size), faces), opening)


def test_choice_decides_among_candidates_only() -> None:
    def last(block: Block, candidates: tuple[Component, ...]) -> Component:
        del block
        return candidates[-1]

    areas = plan_areas(PAPER_PROCEDURE, TEA_BOX, choose=last)
    area = areas.at("r", 1)
    assert area is not None
    assert area.chosen == area.candidates[-1]
    with pytest.raises(ValueError, match="none of its"):
        plan_areas(PAPER_PROCEDURE, TEA_BOX, choose=lambda block, candidates: Component(1, "+x", ("+y", "-y")))


def test_hand_that_can_use_nothing_is_named() -> None:
    opening = Opening("+x", "+y", 0.0)
    plan = fewest_regrasps(PAPER_PROCEDURE, TEA_BOX, opening, usable=lambda hand, task, component: hand != "l")
    assert plan.certificate is not None
    assert plan.certificate.block.resource == "l"
    assert plan.certificate.availability
    assert not plan.certificate.constraints


def test_hold_that_two_tasks_forbid_is_passed_on_by_a_regrasp() -> None:
    tasks = (Task("a", 1, "none", "r"), Task("b", 1, "none", "r"))
    procedure = Procedure(tasks, (Block("r", 1, 2),))
    ends = {"a": 0, "b": 2, "regrasp r": None}

    def usable(hand: str, task: Task, component: Component) -> bool:
        return hand == "l" or ends[task.name] in (None, component.section)

    plan = fewest_regrasps(procedure, TEA_BOX, usable=usable)
    assert plan.certificate is None
    assert plan.regrasps == 1
    assert [task.name for task in plan.procedure.tasks] == ["a", "regrasp r", "b"]


def test_random_procedures_agree_with_the_oracle() -> None:
    rng = np.random.default_rng(2024)
    regrasps: set[int | None] = set()
    for number in range(200):
        case = random_case(rng, 4)
        for reading in READINGS:
            check = check_case(case, reading)
            assert not check.differences, (number, reading, check.differences)
            regrasps.add(check.regrasps)
    assert {None, 0, 1} <= regrasps


@pytest.mark.slow
def test_longer_random_procedures_agree_with_the_oracle() -> None:
    bench = bench_areas(300, seed=7, tasks_max=6)
    assert not bench.differences
    assert bench.outcomes["committed: 1 regrasps added"] > 0


def test_procedure_found_feasible_has_areas_with_the_priorities_it_comes_with() -> None:
    # The later grasp of the right hand fills a gap above the left hand's priority.
    tasks = (Task("a", 3, "none", "l"), Task("b", 2, "none", "l"), Task("c", 3, "none", "r"))
    procedure = Procedure(tasks, (Block("l", 1, 3), Block("r", 3, 3), Block("r", 1, 2, "opening")))
    box = NominalBox(TEA_BOX.size, long_faces(2))
    found = fewest_regrasps(procedure, box, reading="literal")
    assert found.certificate is None
    assert found.reordered
    assert not plan_areas(procedure, box, reading="literal").feasible
    assert plan_areas(found.procedure, box, reading="literal", priorities=found.priorities).feasible
