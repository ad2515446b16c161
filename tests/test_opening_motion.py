"""Laws of the right hand's given motions at the opening, in the opening's frame."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest

from preshape.control.opening_frame import opening_frame
from preshape.control.opening_motion import (
    AWAY_M,
    DEPTH,
    PINCH_TORQUE,
    HandWaypoint,
    open_motion,
    palm_for_tip,
    push_motion,
    thumb_out,
)
from preshape.hal.layout import LAYOUT
from preshape.hal.transform import Matrix, inverse, log_so3
from preshape.hal.world import Face, NominalBox, Opening, face_normal
from preshape.planner.hand_kinematics import hand_kinematics

HAND = LAYOUT.hand("right")
SIZE = np.array([0.06, 0.09, 0.20])
HINGE = 0.07
SIDES_OF_HOLDER = (-1.0, 1.0)


def tip(waypoint: HandWaypoint) -> Matrix:
    """Return the thumb's tip (3,) in the opening's frame, m."""
    X = waypoint.X_opening_palm
    return X[:3, :3] @ hand_kinematics("right").tips(waypoint.fingers)[0][0] + X[:3, 3]


def crossing(waypoint: HandWaypoint) -> Matrix:
    """Return where (x, y) the last phalanx's axis crosses the face's plane z = 0, m."""
    X = waypoint.X_opening_palm @ hand_kinematics("right").tip_poses(waypoint.fingers)[0]
    p, axis = X[:3, 3], X[:3, 0]
    return (p - axis * p[2] / axis[2])[:2]


def named(waypoints: tuple[HandWaypoint, ...], name: str) -> list[HandWaypoint]:
    return [waypoint for waypoint in waypoints if waypoint.name == name]


def motions() -> list[tuple[HandWaypoint, ...]]:
    return [make for toward in SIDES_OF_HOLDER for make in (push_motion(toward), open_motion(toward, HINGE))]


@pytest.mark.parametrize("seed", range(20))
def test_palm_for_tip_puts_the_thumbs_tip_at_the_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    point, fingers = rng.uniform(-0.1, 0.1, 3), thumb_out(bool(seed % 2))
    toward = SIDES_OF_HOLDER[seed % 2]
    X = palm_for_tip(point, rng.uniform(0, 1.2), rng.uniform(-1, 1), toward, fingers)
    np.testing.assert_allclose(X[:3, :3].T @ X[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(X[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(tip(HandWaypoint("p", X, fingers, 1.0)), point, atol=1e-12)


@pytest.mark.parametrize("toward", SIDES_OF_HOLDER)
def test_the_pushing_thumb_crosses_the_face_within_the_tab(toward: float) -> None:
    (deep,) = named(push_motion(toward), "crush")
    tab = NominalBox(SIZE, ("+x", "-x")).tab_size
    assert tip(deep)[2] == pytest.approx(-DEPTH)
    x, y = crossing(deep)
    assert abs(x) < tab[1] / 2 and abs(y) < tab[0] / 2
    (inserted,) = named(open_motion(toward, HINGE), "insert")
    x, y = crossing(inserted)
    assert abs(x) < tab[1] / 2 and abs(y) < tab[0] / 2


@pytest.mark.parametrize(
    ("face", "edge", "offset", "toward"),
    list(product(("+x", "-x"), ("+y", "-y"), (-0.010, -0.005, 0.0, 0.005, 0.010), SIDES_OF_HOLDER)),
)
def test_the_thumb_meets_the_tab_on_the_box_wherever_the_tab_is(
    face: Face, edge: Face, offset: float, toward: float
) -> None:
    box = NominalBox(SIZE, ("+x", "-x"))
    X = opening_frame(box, Opening(face, edge, offset))
    np.testing.assert_allclose(X[:3, :3].T @ X[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(X[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_array_equal(X[:3, 2], face_normal(face))
    np.testing.assert_array_equal(X[:3, 0], face_normal(edge))
    (deep,) = named(push_motion(toward), "crush")
    x, y = crossing(deep)
    entry = (X @ np.array([x, y, 0.0, 1.0]))[:3]
    assert face_normal(face) @ entry == pytest.approx(SIZE[0] / 2)
    from_edge = SIZE[1] / 2 - face_normal(edge) @ entry
    assert 0.0 < from_edge < box.tab_size[1]
    assert abs(entry[2] - offset) < box.tab_size[0] / 2


@pytest.mark.parametrize("toward", SIDES_OF_HOLDER)
def test_the_thumb_comes_and_leaves_well_above_the_face(toward: float) -> None:
    push, lid = push_motion(toward), open_motion(toward, HINGE)
    for waypoint in (push[0], push[-1], lid[0]):
        assert tip(waypoint)[2] == pytest.approx(AWAY_M)
    deepest = min(tip(waypoint)[2] for waypoint in (*push, *lid))
    assert deepest >= -SIZE[0] / 2


@pytest.mark.parametrize("turn_deg", [40.0, 80.0, 100.0])
@pytest.mark.parametrize("toward", SIDES_OF_HOLDER)
@pytest.mark.parametrize("hinge", [0.05, 0.07, 0.09])
def test_the_hand_turns_rigidly_about_the_hinge_by_the_whole_angle(
    turn_deg: float, toward: float, hinge: float
) -> None:
    waypoints = open_motion(toward, hinge, float(np.deg2rad(turn_deg)))
    turns = named(waypoints, "turn")
    before = waypoints[waypoints.index(turns[0]) - 1]
    points = np.array([[-hinge, y, 0.0, 1.0] for y in (-0.1, 0.0, 0.1)]).T
    in_hand = inverse(before.X_opening_palm) @ points
    angles = [0.0]
    for waypoint in turns:
        # The hinge's line keeps its place in the hand: nothing slides.
        np.testing.assert_allclose(waypoint.X_opening_palm @ in_hand, points, atol=1e-12)
        np.testing.assert_array_equal(waypoint.fingers, turns[0].fingers)
        moved = log_so3(waypoint.X_opening_palm[:3, :3] @ before.X_opening_palm[:3, :3].T)
        np.testing.assert_allclose(moved[[0, 2]], 0.0, atol=1e-9)
        angles.append(-moved[1])
    assert np.diff(angles).min() > 0.0
    assert np.rad2deg(angles[-1]) == pytest.approx(turn_deg)
    # Opening lifts what lay on the face, on the tab's side of the hinge.
    lifted = turns[0].X_opening_palm @ inverse(before.X_opening_palm) @ np.array([0.0, 0.0, 0.0, 1.0])
    assert lifted[2] > 0.0


@pytest.mark.parametrize("waypoints", motions(), ids=["push-", "open-", "push+", "open+"])
def test_way_points_are_poses_with_angles_within_the_limits_and_take_time(waypoints: tuple[HandWaypoint, ...]) -> None:
    for waypoint in waypoints:
        R = waypoint.X_opening_palm[:3, :3]
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-9)
        assert np.all(waypoint.fingers >= LAYOUT.lower[HAND] - 1e-9), waypoint.name
        assert np.all(waypoint.fingers <= LAYOUT.upper[HAND] + 1e-9), waypoint.name
        assert waypoint.duration_s > 0.0 and waypoint.finger_torque > 0.0


@pytest.mark.parametrize("toward", SIDES_OF_HOLDER)
def test_the_lid_is_pressed_gently_from_the_hook_to_the_end_of_the_turn_and_only_then(toward: float) -> None:
    gentle = [w.finger_torque == PINCH_TORQUE for w in open_motion(toward, HINGE)]
    assert sum(a != b for a, b in pairwise(gentle)) == 2
    assert any(gentle) and not gentle[0] and not gentle[-1]


def test_both_sides_of_the_holder_are_mirror_motions_in_where_the_tip_goes() -> None:
    for a, b in zip(open_motion(1.0, HINGE)[:7], open_motion(-1.0, HINGE)[:7], strict=True):
        np.testing.assert_allclose(tip(a) * (1.0, -1.0, 1.0), tip(b), atol=1e-12)
