"""The plan: what it promises of each option holds, what it refuses has a reason, and the paper's task has a plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from preshape.hal import sah_hand
from preshape.hal.layout import LAYOUT
from preshape.hal.transform import Matrix, inverse, transform
from preshape.hal.world import Face, NominalBox, Opening, OrientedBox, face_normal, opposite
from preshape.planner.arm_kinematics import palm_pose
from preshape.planner.availability import BODY_CLEARANCE_M, HIDDEN_MAX
from preshape.planner.finger_count import TIP_SIDE
from preshape.planner.hand_clearance import hand_clearance
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.planner.option_choice import RankedOption
from preshape.planner.parts import cylinder_part, l_carton_parts
from preshape.planner.plan import Plan, make_plan
from preshape.planner.plan_scene import Held, PlanScene, held_by_cap
from preshape.planner.postures import STRAIGHT
from preshape.planner.procedure import LIFT_PROCEDURE, PAPER_PROCEDURE
from preshape.planner.sight_line import hidden_share, rectangle_points
from preshape.planner.work_object import WorkObject, box_object, object_of_parts
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import initial_box_pose, nominal_box, workcell
from preshape.tools.configuration import load_scenario

OPENING = Opening("+x", "+y", 0.005)
SEEDS = range(3)


def scene_of(scenario: str | Scenario, seed: int = 0, opening: Opening | None = None) -> PlanScene:
    drawn = (load_scenario(scenario) if isinstance(scenario, str) else scenario).drawn(seed)
    return PlanScene(workcell(drawn), box_object(nominal_box(drawn)), initial_box_pose(drawn), opening)


def all_options(plan: Plan) -> list[RankedOption]:
    return [ranked for grasp in plan.chosen.grasps for ranked in grasp.options]


PLANS = [
    pytest.param(name, seed, opening, id=f"{name}-{seed}-{'after' if opening else 'before'}")
    for name in ("tea_box", "tea_box_lying")
    for seed in SEEDS
    for opening in (None, OPENING)
]


@pytest.mark.parametrize(("name", "seed", "opening"), PLANS)
def test_every_option_does_what_it_says(name: str, seed: int, opening: Opening | None) -> None:
    scene = scene_of(name, seed, opening)
    plan = make_plan(scene)
    assert plan.certificate is None
    assert [str(grasp.block) for grasp in plan.chosen.grasps] == ["right hand, tasks 1-3", "left hand, tasks 3-5"]
    for ranked in all_options(plan):
        option = ranked.option
        kinematics = hand_kinematics(option.side)
        index = [sah_hand.FINGERS.index(finger) for finger in option.fingers]
        X = option.X_object_palm
        tips = kinematics.tips(option.q_hand)[0][index] @ X[:3, :3].T + X[:3, 3]
        assert np.abs(tips - option.tips_object).max() < 1e-4
        assert np.all(option.q_hand >= kinematics.lower)
        assert np.all(option.q_hand <= kinematics.upper)
        assert option.closure.by_line
        assert option.closure.by_cones
        assert ranked.hidden_share <= HIDDEN_MAX
        # The fingertips' surfaces lie a margin outside the grasped faces.
        out = np.array([face_normal(option.thumb_face)] + [face_normal(option.finger_face)] * (len(index) - 1))
        outside = np.sum(option.tips_object * out, axis=1) - np.abs(out) @ option.part.half
        assert np.allclose(outside, option.box.margin + TIP_SIDE, atol=1e-9)
        for pose in ranked.poses:
            base = scene.cell.X_world_base[option.side]
            assert np.allclose(palm_pose(option.side, base, pose.q_arm), pose.X_world_palm, atol=1e-6)
            assert np.allclose(pose.X_world_palm, pose.X_world_object @ X)
            arm = LAYOUT.arm(option.side)
            assert np.all((pose.q_arm > LAYOUT.lower[arm]) & (pose.q_arm < LAYOUT.upper[arm]))


@pytest.mark.parametrize(("name", "seed", "opening"), PLANS)
def test_chosen_grasping_plane_is_the_preshaping_boxs(name: str, seed: int, opening: Opening | None) -> None:
    for ranked in all_options(make_plan(scene_of(name, seed, opening))):
        X = inverse(ranked.option.X_object_pb) @ ranked.option.reached_plane()
        assert np.abs(X - np.eye(4)).max() < 5e-3


@pytest.mark.parametrize("seed", SEEDS)
def test_standing_box_is_taken_by_its_upper_cap_and_handed_over_by_the_lower(seed: int) -> None:
    plan = make_plan(scene_of("tea_box", seed))
    right, left = plan.options("r", 1)[0], plan.options("l", 3)[0]
    assert right.option.palm_face == "+z"
    assert left.option.palm_face == "-z"
    assert set(right.faces) == {"+x", "-x"}
    assert plan.options("r", 4) == ()
    assert plan.options("l", 1) == ()
    pairs = {(r.option.finger_face, r.option.thumb_face) for r in plan.options("r", 1) if r.option.palm_face == "+z"}
    assert {("+y", "-y"), ("-y", "+y")} <= pairs


@pytest.mark.parametrize("seed", SEEDS)
def test_lying_box_is_taken_from_above_at_an_end(seed: int) -> None:
    plan = make_plan(scene_of("tea_box_lying", seed))
    for ranked in plan.options("r", 1):
        assert ranked.option.palm_face == "+x"
        assert ranked.option.component.section != 1


def test_nothing_lies_on_the_table_or_hits_it() -> None:
    for name in ("tea_box", "tea_box_lying"):
        scene = scene_of(name, 1)
        for ranked in make_plan(scene).options("r", 1):
            option = ranked.option
            X = scene.X_world_object
            contacts = option.contacts_object @ X[:3, :3].T + X[:3, 3]
            assert contacts[:, 2].min() > 0.005
            X_palm = X @ option.X_object_palm
            assert hand_clearance(option.side, X_palm, option.q_hand, scene.bodies)[0] >= BODY_CLEARANCE_M


@pytest.mark.parametrize("seed", SEEDS)
def test_second_call_keeps_what_is_held_and_leaves_the_opening_free(seed: int) -> None:
    before = scene_of("tea_box", seed)
    taken = make_plan(before).options("r", 1)[0]
    X_shown = next(pose.X_world_object for pose in taken.poses if pose.place == "shown")
    held = Held("r", taken.option.component, taken.option.thumb_face)
    assert held == held_by_cap("r", taken.option.palm_face, taken.option.finger_face)
    plan = make_plan(replace(before, X_world_object=X_shown, opening=OPENING, held=held))
    assert plan.certificate is None
    (right,) = plan.options("r", 3)
    assert right.option.component == taken.option.component
    for ranked in plan.options("l", 3):
        assert OPENING.face not in ranked.option.component.pair
        assert ranked.option.component.section != taken.option.component.section
        handed = [pose for pose in ranked.poses if pose.place == "handed over"]
        assert np.array_equal(handed[0].X_world_object, X_shown)


def test_options_are_ranked_and_the_chosen_one_comes_first() -> None:
    for name in ("tea_box", "tea_box_lying"):
        for grasp in make_plan(scene_of(name)).chosen.grasps:
            ranks = [ranked.rank for ranked in grasp.options]
            assert ranks[1:] == sorted(ranks[1:])
            assert grasp.chosen is grasp.options[0]
            assert len({str(ranked.option) for ranked in grasp.options}) == len(grasp.options)


def test_same_scene_gives_the_same_plan() -> None:
    first, second = (make_plan(scene_of("tea_box", 2)) for _ in range(2))
    for a, b in zip(all_options(first), all_options(second), strict=True):
        assert str(a.option) == str(b.option)
        assert np.array_equal(a.option.X_object_palm, b.option.X_object_palm)
        assert all(np.array_equal(p.q_arm, q.q_arm) for p, q in zip(a.poses, b.poses, strict=True))


def test_likely_face_is_the_only_one_that_must_be_shown() -> None:
    scene = replace(scene_of("tea_box_lying"), likely="+x")
    assert all(ranked.faces == ("+x",) for ranked in make_plan(scene).options("r", 1))


@pytest.mark.parametrize("seed", SEEDS)
def test_box_whose_opening_lies_below_is_passed_on_before_it_is_shown(seed: int) -> None:
    plan = make_plan(replace(scene_of("tea_box_lying", seed), likely="-x")).chosen
    assert plan.certificate is None
    assert [task.name for task in plan.procedure.tasks[:3]] == ["grasp", "regrasp r", "find"]
    first, again = plan.grasp("r", 1), plan.grasp("r", 3)
    helper = plan.grasp("l", 2)
    assert first is not None
    assert again is not None
    assert helper is not None
    assert first.chosen.option.palm_face == "+x"
    for right in (first, again):
        assert not helper.chosen.option.component.patches & right.chosen.option.component.patches


def test_priorities_of_the_plan_are_equation_3() -> None:
    plan = make_plan(scene_of("tea_box", opening=OPENING))
    assert plan.chosen.priorities == {
        "r": [2, 2, 2, 1, 1],
        "l": [None, None, 3, 3, 3],
        "c": [None, 1, None, None, None],
    }


def refusing(scene: PlanScene) -> str:
    """Return all reasons of a plan that must not exist."""
    plan = make_plan(scene)
    assert plan.certificate is not None
    assert plan.certificate.availability
    assert plan.options("r", 1) == ()
    assert plan.chosen.refusals
    return "\n".join(str(refusal) for refusal in plan.chosen.refusals)


def test_box_that_no_hand_can_span_has_no_plan() -> None:
    scene = scene_of("tea_box")
    wide = NominalBox(np.array([0.40, 0.38, 0.60]), ("+x", "-x"))
    X = transform((0.55, -0.30, 0.30))
    assert "beyond the hand's span" in refusing(replace(scene, target=box_object(wide), X_world_object=X))


def test_box_out_of_reach_has_no_plan() -> None:
    scene = scene_of("tea_box")
    assert "out of the arm's reach" in refusing(replace(scene, X_world_object=transform((1.6, -0.3, 0.1))))


def test_body_on_top_of_the_box_takes_its_cap_away() -> None:
    scene = scene_of("tea_box")
    lid = OrientedBox("brick", scene.X_world_object @ transform((0.0, 0.0, 0.1 + 0.01)), np.array([0.05, 0.05, 0.01]))
    plan = make_plan(replace(scene, obstacles=(lid,)))
    reasons = "\n".join(str(refusal) for refusal in plan.chosen.refusals)
    assert "section 2, palm +z, grasp +x -x, thumb +x, here: face on the brick" in reasons
    assert all(ranked.option.palm_face != "+z" for ranked in plan.options("r", 1))
    # What is left goes by the middle, which must be seen in task 2: the hand regrasps before.
    assert plan.certificate is not None or plan.chosen.regrasps > 0


def test_literal_reading_has_the_left_hand_behind_the_opening_or_a_certificate() -> None:
    plan = make_plan(scene_of("tea_box", opening=OPENING), reading="literal")
    if plan.certificate is None:
        assert {r.option.palm_face for r in plan.options("l", 3)} == {opposite(OPENING.face)}
    else:
        assert plan.certificate.block.resource == "l"
        area = plan.chosen.areas.at("l", 3)
        assert area is not None
        assert [c.section for c in area.components] == [1]


def object_scene(target: WorkObject, height: float) -> PlanScene:
    cell = scene_of("tea_box").cell
    return PlanScene(cell, target, transform((0.50, -0.30, height)))


@pytest.mark.parametrize("yaw", [0.0, 1.2, 2.4])
def test_parts_of_an_l_carton_are_planned_one_by_one(yaw: float) -> None:
    target = object_of_parts(l_carton_parts((0.16, 0.08, 0.20), 0.06))
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    scene = object_scene(target, 0.10)
    scene = replace(scene, X_world_object=scene.X_world_object @ transform(R=turn))
    plan = make_plan(scene, LIFT_PROCEDURE)
    assert plan.certificate is None
    assert [part.part.name for part in plan.parts] == ["upright", "foot"]
    for part in plan.parts:
        for grasp in part.grasps:
            for ranked in grasp.options:
                option = ranked.option
                boxes = target.boxes(np.eye(4))
                assert hand_clearance(option.side, option.X_object_palm, option.q_hand, boxes)[0] >= 0.0
    reasons = [str(refusal) for part in plan.parts for refusal in part.refusals]
    assert any("covered by foot" in reason for reason in reasons)
    assert any("covered by upright" in reason for reason in reasons)


def test_cylinder_is_taken_around_its_smallest_box() -> None:
    plan = make_plan(object_scene(object_of_parts([cylinder_part("can", 0.035, 0.16)]), 0.08), LIFT_PROCEDURE)
    assert plan.certificate is None
    best = plan.options("r", 1)[0].option
    assert best.palm_face == "+z"
    assert best.box.grasped_width == pytest.approx(0.07, abs=1e-6)


def test_hand_before_the_eye_hides_everything_and_beside_it_nothing() -> None:
    points = rectangle_points(np.array([-0.03, -0.03, 0.0]), np.array([0.03, 0.03, 0.0]))
    assert len({tuple(p) for p in points}) == len(points) == 36
    eye = np.array([0.0, 0.0, 1.0])
    face_on = transform((0.0, -0.06, 0.3), np.column_stack([[0, 0, 1.0], [1.0, 0, 0], [0, 1.0, 0]]))
    assert hidden_share(eye, points, "right", face_on, STRAIGHT) == 1.0
    aside = transform((0.5, 0.0, 0.3))
    assert hidden_share(eye, points, "right", aside, STRAIGHT) == 0.0


def test_part_way_hidden_share_matches_a_sampled_hand() -> None:
    points = rectangle_points(np.array([-0.06, -0.06, 0.0]), np.array([0.06, 0.06, 0.0]))
    eye = np.array([0.0, 0.0, 1.0])
    shares: list[float] = []
    for y in np.linspace(-0.3, 0.2, 11):
        X: Matrix = transform((0.0, y, 0.3), np.column_stack([[0, 0, 1.0], [1.0, 0, 0], [0, 1.0, 0]]))
        shares.append(hidden_share(eye, points, "right", X, STRAIGHT))
    assert 0.0 in shares
    assert max(shares) > 0.9
    assert any(0.0 < share < 0.9 for share in shares)


def test_papers_procedure_names_where_each_task_has_the_box() -> None:
    places = [task.place for task in PAPER_PROCEDURE.tasks]
    assert places == ["here", "shown", "handed over", "opened", "opened"]
    faces: tuple[Face, ...] = scene_of("tea_box").faces(scene_of("tea_box").target.parts[0])
    assert faces == ("+x", "-x")
