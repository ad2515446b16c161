"""Laws of the coarse collision model, of reachability and of joint paths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from preshape.control.distances import Boxes, PairDistances, pair_distances
from preshape.hal.description import part_box
from preshape.hal.layout import LAYOUT, SIDES, Side
from preshape.hal.transform import rpy_matrix, transform
from preshape.hal.world import CameraModel, OrientedBox, Workcell
from preshape.planner.arm_capsules import HeldBox, box_segments
from preshape.planner.arm_collision import FAR, ArmCollision
from preshape.planner.arm_kinematics import arm_jacobian, manipulability, palm_pose
from preshape.planner.arm_path import ALLOWED_DIP, ArmPath, PathQuery, PathStatus, arm_limits, plan_path, way_out
from preshape.planner.arm_reach import ReachStatus, ranked_postures, reach, score
from preshape.planner.capsule_distance import segment_box_distance, segment_distance

BASES: dict[Side, np.ndarray] = {"right": transform((0.0, -0.4, 0.1)), "left": transform((0.0, 0.4, 0.1))}
TABLE = OrientedBox("table", transform((0.55, 0.0, -0.025)), np.array([0.4, 0.6, 0.025]))
CELL = Workcell(BASES, (TABLE,), CameraModel(np.eye(4), 700.0, 1280, 720))
HANDS: dict[Side, np.ndarray] = {side: LAYOUT.lower[LAYOUT.hand(side)].clip(min=0.0) for side in SIDES}
HOME_RIGHT = np.array([-1.372, -0.859, 1.185, -2.359, 0.814, 1.836, -0.890])
HOME = np.concatenate([HOME_RIGHT, HOME_RIGHT * [-1, 1, -1, 1, -1, 1, -1]])
ABOVE_BOX = np.array([-1.62, -0.68, 1.64, -1.85, 0.71, 1.83, 0.61])


FACE_SAG_M = 0.0115
"""How far the middle of a palm's face sticks out of its capsules, m."""


def _with_right(q: np.ndarray) -> np.ndarray:
    return np.concatenate([q, HOME[7:]])


def test_segment_distance_is_the_least_over_both_segments() -> None:
    rng = np.random.default_rng(0)
    for case in range(200):
        a0, a1, b0, b1 = rng.uniform(-1, 1, (4, 3))
        if case % 4 == 0:
            b1 = b0 + (a1 - a0) * rng.uniform(-1, 1)
        if case % 10 == 1:
            a1 = a0
        s, t = np.meshgrid(np.linspace(0, 1, 201), np.linspace(0, 1, 201))
        gaps = (a0 - b0) + s[..., None] * (a1 - a0) - t[..., None] * (b1 - b0)
        grid = np.linalg.norm(gaps, axis=-1).min()
        exact = segment_distance(a0, a1, b0, b1)
        assert exact <= grid + 1e-12
        assert grid - exact < 0.03


def test_segment_box_distance_is_the_least_along_the_segment() -> None:
    rng = np.random.default_rng(1)
    half = np.array([0.2, 0.3, 0.4])
    for _ in range(100):
        X = transform(rng.uniform(-1, 1, 3), rpy_matrix(rng.uniform(-3, 3, 3)))
        p0, p1 = rng.uniform(-1.5, 1.5, (2, 3))
        t = np.linspace(0, 1, 4001)[:, None]
        p = (p0 + t * (p1 - p0) - X[:3, 3]) @ X[:3, :3]
        gap = np.abs(p) - half
        signed = np.where((gap > 0).any(1), np.linalg.norm(gap.clip(min=0), axis=1), gap.max(1))
        assert segment_box_distance(p0, p1, X, half) == pytest.approx(signed.min(), abs=1e-3)
        assert segment_box_distance(p0, p1, X, half) <= signed.min() + 1e-9


def test_capsules_of_a_box_leave_no_more_than_their_stated_part_of_the_corners_uncovered() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        half = rng.uniform(0.02, 0.15, 3)
        segments = box_segments(np.eye(4), half)
        corner_gap = max(
            min(segment_distance(p, p, a, b) - r for a, b, r in segments) for p in rng.choice([-1, 1], (40, 3)) * half
        )
        assert corner_gap <= (np.sqrt(3) - 1) * half.min() + 1e-9
        inside = rng.uniform(-1, 1, (100, 3)) * half
        assert all(min(segment_distance(p, p, a, b) - r for a, b, r in segments) <= corner_gap + 1e-9 for p in inside)
        for a, b, r in segments:
            assert (np.maximum(np.abs(a), np.abs(b)) + r <= half + 1e-12).all()


def test_clearance_names_the_bodies_that_overlap() -> None:
    model = ArmCollision(CELL, HANDS)
    assert model.clearance(HOME).distance > 0.02
    into_table = reach("right", BASES["right"], transform((0.5, -0.3, 0.15), rpy_matrix((np.pi, 0, 0))))
    overlap = model.clearance(_with_right(into_table.q))
    assert overlap.distance < 0.0 and overlap.bodies == ("right_hand", "table")


def test_exempt_bodies_may_touch_and_unknown_names_are_refused() -> None:
    into_table = _with_right(reach("right", BASES["right"], transform((0.5, -0.3, 0.15), rpy_matrix((np.pi, 0, 0)))).q)
    assert ArmCollision(CELL, HANDS, exempt=[("right_hand", "table")]).clearance(into_table).distance > 0.0
    with pytest.raises(ValueError, match="allowed are"):
        ArmCollision(CELL, HANDS, exempt=[("right_hand", "tabel")])


def test_held_box_counts_as_part_of_the_hand_that_holds_it() -> None:
    low = _with_right(reach("right", BASES["right"], transform((0.5, -0.3, 0.35), rpy_matrix((np.pi, 0, 0)))).q)
    held = HeldBox("right", transform((0.0, 0.0, 0.27)), np.array([0.03, 0.045, 0.1]))
    assert ArmCollision(CELL, HANDS, held).clearance(low).bodies == ("held", "table")
    assert ArmCollision(CELL, HANDS).clearance(low).distance > 0.0


def test_is_free_agrees_with_clearance() -> None:
    model = ArmCollision(CELL, HANDS)
    lower, upper = arm_limits(0.0)
    distances = []
    for q in np.random.default_rng(4).uniform(lower, upper, (300, 14)):
        distance = model.clearance(q).distance
        distances.append(distance)
        assert model.is_free(q, 0.03) == (distance >= 0.03)
    assert min(distances) < 0.0 < max(distances) < FAR


def test_what_has_appeared_is_nowhere_nearer_than_the_model_says_but_for_the_sag_of_faces() -> None:
    rng = np.random.default_rng(8)
    held = HeldBox("right", transform((0.0, 0.0, 0.22)), np.array([0.03, 0.045, 0.1]))
    X_palm, (center, half) = palm_pose("right", BASES["right"], HOME[:7]), part_box("right", "palm")
    bodies = Boxes.of(
        [
            OrientedBox("palm", X_palm @ transform(center), half),
            OrientedBox("held", X_palm @ held.X_palm_box, held.half),
        ]
    )
    beyond = 0
    for number in range(200):
        corner = bodies.R[number % 2] @ (rng.choice([-1.0, 1.0], 3) * bodies.h[number % 2]) + bodies.p[number % 2]
        box = OrientedBox("new", transform(corner + rng.normal(0.0, 0.03, 3)), np.full(3, 0.01))
        exact = PairDistances.empty(2)
        pair_distances("l2", bodies, Boxes.of([box]), np.array([[0, 0], [1, 0]]), exact)
        coarse = ArmCollision(CELL, HANDS, held, (box,)).clearance(HOME).distance
        fine = ArmCollision(CELL, HANDS, held, appeared=(box,)).clearance(HOME).distance
        assert fine <= coarse
        if exact.distance.min() >= 0.0:
            assert fine <= exact.distance.min() + FACE_SAG_M
            beyond += coarse > exact.distance.min() + FACE_SAG_M
    assert beyond >= 10, "the coarse shapes alone would not do"


def test_from_what_has_appeared_more_is_kept_and_from_nothing_else() -> None:
    place = palm_pose("right", BASES["right"], HOME[:7])[:3, 3] + [0.0, -0.2, 0.0]
    post = OrientedBox("post", transform(place), np.full(3, 0.02))
    known, new = ArmCollision(CELL, HANDS, None, (post,)), ArmCollision(CELL, HANDS, appeared=(post,))
    distance = new.clearance(HOME).distance
    assert new.clearance(HOME).bodies == ("right_hand", "post") and 0.0 < distance <= known.clearance(HOME).distance
    assert new.is_free(HOME, distance - 0.011, 0.010) and not new.is_free(HOME, distance - 0.009, 0.010)
    assert known.is_free(HOME, distance - 0.009, 0.010)
    assert known.margins(0.02, more=0.01).max() == pytest.approx(0.02)
    assert set(np.round(new.margins(0.02, more=0.01), 12)) == {0.02, 0.03}
    near = np.isclose(new.margins(0.02, (HOME,), ALLOWED_DIP, 1.0), distance - ALLOWED_DIP)
    assert near.sum() == 1, "two that are nearer than that at an end of a path keep what they have"


def test_a_way_out_leads_straight_to_where_there_is_room_and_never_nearer() -> None:
    palm = palm_pose("right", BASES["right"], HOME[:7])[:3, 3]
    query, right = PathQuery(margin_m=0.008, more_m=0.015, step_rad=0.02), np.arange(7)
    for gap in (0.10, 0.11, 0.12):
        model = ArmCollision(
            CELL, HANDS, appeared=(OrientedBox("post", transform(palm - [0, gap, 0]), np.full(3, 0.03)),)
        )
        assert model.clearance(HOME).distance < query.margin_m + query.more_m
        q = way_out(model, HOME, right, query, model)
        assert q is not None and np.array_equal(q[7:], HOME[7:]) and np.abs(q - HOME).max() < 0.5
        assert model.is_free(q, query.margin_m, query.more_m)
        on_the_way = [model.clearance(HOME + u * (q - HOME)).distance for u in np.linspace(0.0, 1.0, 200)]
        assert min(on_the_way) >= model.clearance(HOME).distance - 5e-4
        again = way_out(model, HOME, right, query, model)
        assert again is not None and np.array_equal(again, q)
    walled = tuple(
        OrientedBox(f"wall{k}", transform(palm + at), np.full(3, 0.12))
        for k, at in enumerate(0.3 * np.vstack([np.eye(3), -np.eye(3)]))
    )
    shut = ArmCollision(CELL, HANDS, appeared=walled)
    assert way_out(shut, HOME, right, PathQuery(margin_m=0.5), shut) is None


def test_score_is_the_lesser_of_limit_margin_and_manipulability() -> None:
    lower, upper = arm_limits(0.0)
    for q in np.random.default_rng(5).uniform(lower, upper, (100, 14))[:, :7]:
        margin = np.rad2deg(min((q - lower[:7]).min(), (upper[:7] - q).min()))
        expected = min(margin, 600 * manipulability(arm_jacobian("right", np.eye(4), q)))
        assert score("right", q) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("side", SIDES)
def test_reach_returns_a_posture_at_the_pose_with_the_best_score(side: Side) -> None:
    X = palm_pose(side, BASES[side], HOME_RIGHT if side == "right" else HOME[7:])
    found = reach(side, BASES[side], X)
    assert found.status is ReachStatus.REACHABLE
    assert np.allclose(palm_pose(side, BASES[side], found.q), X, atol=1e-9)
    assert found.score == pytest.approx(ranked_postures(side, BASES[side], X)[1].max())
    assert found.score >= score(side, HOME_RIGHT if side == "right" else HOME[7:]) - 0.5


def test_reach_says_why_not() -> None:
    model = ArmCollision(CELL, HANDS)
    down = rpy_matrix((np.pi, 0.0, 0.0))
    assert reach("right", BASES["right"], transform((1.5, 0, 0.3), down)).status is ReachStatus.NO_SOLUTION
    collides = reach("right", BASES["right"], transform((0.5, -0.3, 0.15), down), model, HOME)
    assert collides.status is ReachStatus.COLLIDES and "table" in collides.nearest
    with pytest.raises(ValueError, match="q_arms"):
        reach("right", BASES["right"], transform((0.5, -0.3, 0.4), down), model)


def _assert_keeps_margin(model: ArmCollision, path: ArmPath, start: np.ndarray, goal: np.ndarray) -> None:
    assert path.status is PathStatus.FOUND
    assert np.array_equal(path.waypoints[0], start) and np.array_equal(path.waypoints[-1], goal)
    lower, upper = arm_limits(0.0)
    for a, b in zip(path.waypoints[:-1], path.waypoints[1:], strict=True):
        for t in np.linspace(0, 1, 60):
            q = a + t * (b - a)
            assert model.clearance(q).distance >= path.margin - 0.005
            assert (q >= lower).all() and (q <= upper).all()


def test_a_free_straight_path_is_taken() -> None:
    model = ArmCollision(CELL, HANDS)
    path = plan_path(model, HOME, _with_right(ABOVE_BOX))
    assert len(path.waypoints) == 2
    _assert_keeps_margin(model, path, HOME, _with_right(ABOVE_BOX))
    other = plan_path(model, HOME, _with_right(ABOVE_BOX), PathQuery(seed=1))
    assert not path.by_chance
    assert np.array_equal(path.waypoints, other.waypoints)


def test_a_path_leads_around_an_obstacle_and_leaves_the_other_arm_alone() -> None:
    start, goal = _with_right(ABOVE_BOX), ABOVE_BOX.copy()
    goal[0] -= 0.9
    goal = _with_right(goal)
    middle = palm_pose("right", BASES["right"], (0.5 * (start + goal))[:7])
    wall = OrientedBox("wall", transform(middle[:3, 3] - [0, 0, 0.2]), np.array([0.05, 0.05, 0.3]))
    model = ArmCollision(CELL, HANDS, obstacles=(wall,))
    assert not model.edge_free(start, goal, model.margins(0.0))
    path = plan_path(model, start, goal)
    other = plan_path(model, start, goal, PathQuery(seed=1))
    assert path.by_chance and not np.array_equal(path.waypoints, other.waypoints)
    _assert_keeps_margin(model, path, start, goal)
    assert np.ptp(path.waypoints[:, 7:], axis=0).max() == 0.0


def test_the_same_query_gives_the_same_path() -> None:
    wall = OrientedBox("wall", transform((0.55, -0.1, 0.3)), np.array([0.2, 0.02, 0.4]))
    model = ArmCollision(CELL, HANDS, obstacles=(wall,))
    goal = _with_right(reach("right", BASES["right"], transform((0.5, 0.1, 0.5), rpy_matrix((np.pi, 0, 0)))).q)
    first, second = (plan_path(model, HOME, goal, PathQuery(iterations=300)) for _ in range(2))
    assert first.status is second.status
    assert np.array_equal(first.waypoints, second.waypoints)


def test_blocked_ends_and_joints_outside_their_limits_are_named() -> None:
    model = ArmCollision(CELL, HANDS)
    into_table = _with_right(reach("right", BASES["right"], transform((0.5, -0.3, 0.15), rpy_matrix((np.pi, 0, 0)))).q)
    blocked = plan_path(model, HOME, into_table)
    assert not blocked.by_chance
    assert blocked.status is PathStatus.GOAL_BLOCKED and blocked.bodies == ("right_hand", "table")
    assert plan_path(model, into_table, HOME).status is PathStatus.START_BLOCKED
    outside = HOME.copy()
    outside[3] = 0.1
    assert plan_path(model, HOME, outside).status is PathStatus.OUTSIDE_LIMITS


def test_a_path_keeps_what_clearance_its_own_end_has() -> None:
    model = ArmCollision(CELL, HANDS)
    low = minimize(
        lambda z: (model.clearance(_with_right(_palm_down(z[0]))).distance - 0.005) ** 2, [0.34], method="Nelder-Mead",
        options={"maxiter": 40},
    )  # fmt: skip
    goal = _with_right(_palm_down(float(low.x[0])))
    assert 0.0 < model.clearance(goal).distance < 0.02
    path = plan_path(model, HOME, goal)
    assert path.margin == pytest.approx(model.clearance(goal).distance - ALLOWED_DIP)
    _assert_keeps_margin(model, path, HOME, goal)


def test_a_hand_that_stands_near_an_obstacle_does_not_let_the_box_in_it_come_near_to_the_table() -> None:
    held = HeldBox("right", transform((0.0, 0.0, 0.22)), np.array([0.03, 0.045, 0.1]))
    low, high = _with_right(_palm_down(0.34)), _with_right(_palm_down(0.50))
    beside = palm_pose("right", BASES["right"], high[:7])[:3, 3] + [0.0, -0.15, 0.0]
    model = ArmCollision(CELL, HANDS, held, (OrientedBox("post", transform(beside), np.array([0.02, 0.02, 0.02])),))
    assert 0.0 < model.clearance(high).distance < 0.030 and model.clearance(high).bodies == ("right_hand", "post")
    margins = model.margins(0.035, (high,), ALLOWED_DIP)
    assert margins.min() == pytest.approx(model.clearance(high).distance - ALLOWED_DIP)
    assert model.edge_free(high, high, margins)
    alone = ArmCollision(CELL, HANDS, held)
    assert 0.0 < alone.clearance(low).distance < 0.030 and alone.clearance(low).bodies == ("held", "table")
    assert model.clearance(low).distance > margins.min(), "the least margin of all would let it go there"
    assert not model.edge_free(high, low, margins)


def _palm_down(z: float) -> np.ndarray:
    X = transform((0.5, -0.3, z), rpy_matrix((np.pi, 0.0, 0.0)))
    return ranked_postures("right", BASES["right"], X, near=HOME_RIGHT)[0][0]
