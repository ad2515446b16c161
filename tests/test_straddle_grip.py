"""Laws of the grip that takes a lying box from above, and of standing it on an end cap."""

from itertools import pairwise, product

import numpy as np
import pytest

from preshape.control.grip import Grip
from preshape.control.straddle_grip import HEIGHTS, WIDTHS, straddle_grip, straddle_pose
from preshape.control.task_stand import (
    AWAY_M,
    PLACES,
    YAWS,
    away,
    grips,
    laid_flat,
    long_face_up,
    raised,
    standing,
)
from preshape.hal.description import part_box
from preshape.hal.layout import HAND_DOF
from preshape.hal.sah_hand import ACTUATED
from preshape.hal.transform import Matrix, axis_rotation, inverse, transform
from preshape.hal.world import Face, NominalBox, face_normal
from preshape.planner.hand_kinematics import PART_NAMES, hand_kinematics

SIZE = np.array([0.06, 0.09, 0.20])
CLEAR_M = 0.004
TIP_RADIUS_M = 0.0125
CASES: list[tuple[Face, Face, Face]] = [
    (up, side, end) for up, side, end in product(("+x", "-x"), ("+y", "-y"), ("+z", "-z"))
]


def lying(yaw: float, up: Face, size: Matrix = SIZE) -> Matrix:
    turn = np.eye(3) if up == "+x" else axis_rotation(np.array([0.0, 0.0, 1.0]), np.pi)
    # Box x to world z, box z along the table.
    R = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]) @ turn
    Rz = axis_rotation(np.array([0.0, 0.0, 1.0]), yaw)
    return transform((0.55, -0.30, size[0] / 2), Rz @ R)


def dist_points(X_world_palm: Matrix, q: Matrix) -> dict[str, Matrix]:
    """Return the two ends (2, 3) of every last phalanx's axis in the world, m."""
    poses = hand_kinematics("right").part_poses(q)
    ends: dict[str, Matrix] = {}
    for finger in ("thumb", "fore", "middle", "ring"):
        X = X_world_palm @ poses[PART_NAMES.index(f"{finger}_dist")]
        ends[finger] = np.array([(X @ np.array([s, 0.0, 0.0, 1.0]))[:3] for s in (0.001, 0.0268)])
    return ends


def closed(grip_preshape: Matrix, X_box_palm: Matrix, finger_face: Face, half: float) -> Matrix:
    """Return the angles at which each flexing finger meets its side of the box."""
    q = grip_preshape.copy()
    n = face_normal(finger_face)
    for finger in ("thumb", "fore", "middle", "ring"):
        j = ACTUATED.index(f"{finger}_flex")
        sign = -1.0 if finger == "thumb" else 1.0
        for angle in np.linspace(q[j], q[j] + 0.75, 400):
            q[j] = angle
            if float((sign * dist_points(X_box_palm, q)[finger] @ n).min()) - TIP_RADIUS_M <= half:
                break
        else:
            pytest.fail(f"{finger} does not meet the box")
    return q


@pytest.mark.parametrize("case", CASES)
def test_fingertips_clear_the_table_open_and_closed_at_any_yaw(case: tuple[Face, Face, Face]) -> None:
    up, side, end = case
    for width, height in product(WIDTHS, HEIGHTS):
        size = np.array([height, width, 0.20])
        grip = straddle_grip(size, up, side, end)
        q_met = closed(grip.preshape, grip.X_box_palm, side, width / 2)
        for yaw in np.linspace(-np.pi, np.pi, 7):
            X_palm = lying(float(yaw), up, size) @ grip.X_box_palm
            for q in (grip.preshape, q_met):
                lowest = min(float(ends[:, 2].min()) for ends in dist_points(X_palm, q).values()) - TIP_RADIUS_M
                assert lowest >= CLEAR_M


@pytest.mark.parametrize("case", CASES)
def test_open_hand_goes_around_the_box(case: tuple[Face, Face, Face]) -> None:
    up, side, end = case
    grip = straddle_grip(SIZE, up, side, end)
    n = face_normal(side)
    for finger, ends in dist_points(grip.X_box_palm, grip.preshape).items():
        out = (-1.0 if finger == "thumb" else 1.0) * (ends @ n)
        assert float(out.min()) - TIP_RADIUS_M - SIZE[1] / 2 >= 0.010


@pytest.mark.parametrize("case", CASES)
def test_palm_stays_above_the_box(case: tuple[Face, Face, Face]) -> None:
    up, side, end = case
    X_box_palm = straddle_pose(SIZE, up, side, end)
    center, half = part_box("right", "palm")
    corners = center + np.array(list(product(*([-h, h] for h in half))))
    heights = (X_box_palm @ np.c_[corners, np.ones(8)].T)[:3].T @ face_normal(up)
    assert heights.min() - SIZE[0] / 2 >= 0.02


def test_palm_lies_nearer_the_end_that_comes_up() -> None:
    for up, side, end in CASES:
        X = straddle_pose(SIZE, up, side, end)
        assert X[:3, 3] @ face_normal(end) > 0.0


@pytest.mark.parametrize("width", [WIDTHS[0] - 0.002, WIDTHS[1] + 0.002])
def test_unsuitable_width_is_refused_by_name(width: float) -> None:
    with pytest.raises(ValueError, match="width between thumb and fingers"):
        straddle_grip(np.array([0.06, width, 0.20]), "+x", "+y", "+z")


@pytest.mark.parametrize("height", [HEIGHTS[0] - 0.002, HEIGHTS[1] + 0.002])
def test_unsuitable_height_is_refused_by_name(height: float) -> None:
    with pytest.raises(ValueError, match="height of the lying box"):
        straddle_grip(np.array([height, 0.09, 0.20]), "+x", "+y", "+z")


def test_parallel_faces_are_refused() -> None:
    with pytest.raises(ValueError, match="perpendicular"):
        straddle_pose(SIZE, "+x", "-x", "+z")


BOX = NominalBox(SIZE, ("+x", "-x"))


def test_a_lying_box_is_laid_flat_from_a_tilted_estimate() -> None:
    rng = np.random.default_rng(3)
    ups: tuple[Face, ...] = ("+x", "-x")
    for up in ups:
        for yaw in np.linspace(-3.0, 3.0, 9):
            true = lying(float(yaw), up)
            seen = true.copy()
            axis = rng.normal(size=3)
            seen[:3, :3] = axis_rotation(axis / np.linalg.norm(axis), 0.05) @ true[:3, :3]
            seen[2, 3] += 0.004
            flat = laid_flat(seen, BOX)
            assert long_face_up(seen, BOX) == up
            assert np.allclose(flat[:3, :3].T @ flat[:3, :3], np.eye(3)) and np.linalg.det(flat[:3, :3]) > 0.0
            assert np.allclose(flat[:3, :3] @ face_normal(up), [0.0, 0.0, 1.0])
            assert np.allclose(flat[2, 3], 0.03)
            assert np.arccos(np.clip((np.trace(flat[:3, :3].T @ true[:3, :3]) - 1) / 2, -1, 1)) < 0.06


def test_a_stood_box_rests_on_the_table_with_its_end_up_and_the_hand_level() -> None:
    for grip, end in grips(BOX, "+x"):
        for place, yaw in product(PLACES, YAWS):
            X = standing(BOX, end, "+x", place, yaw)
            assert np.allclose(X[:3, :3] @ face_normal(end), [0.0, 0.0, 1.0]) and np.isclose(X[2, 3], 0.10)
            X_palm = X @ grip.X_box_palm
            assert np.isclose(X_palm[2, 2], 0.0, atol=1e-12)
            assert X_palm[2, 3] > 0.10


def test_the_hand_draws_back_level_until_its_tips_have_left_the_box() -> None:
    grip, end = next(grips(BOX, "+x"))
    X_stand = standing(BOX, end, "+x", PLACES[0], 0.7)
    X_palm = X_stand @ grip.X_box_palm
    path = [away(X_palm, X_stand, "+x", d) for d in np.linspace(0.0, AWAY_M, 12)]
    assert all(np.isclose(a[2, 3], b[2, 3]) for a, b in pairwise(path))
    for ends in dist_points(inverse(X_stand) @ path[-1], grip.preshape).values():
        assert float((ends @ face_normal("+x")).min()) - TIP_RADIUS_M - SIZE[0] / 2 >= 0.02


def test_every_grip_brings_its_own_end_up() -> None:
    found: list[tuple[Grip, Face]] = list(grips(BOX, "-x"))
    assert len(found) == 4 and {end for _, end in found} == {"+z", "-z"}
    for grip, end in found:
        assert grip.X_box_palm[:3, 3] @ face_normal(end) > 0.0
        assert np.isfinite(grip.torques).sum() == 4 and len(grip.torques) == HAND_DOF


def test_raising_keeps_the_direction() -> None:
    X = lying(0.4, "+x")
    assert np.allclose(raised(X, 0.1)[:3, :3], X[:3, :3]) and np.isclose(raised(X, 0.1)[2, 3], X[2, 3] + 0.1)
