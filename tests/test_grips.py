"""Laws of the grips by an end cap: where the box lies between palm, fingers and thumb, for every way to take it."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from preshape.control import grips
from preshape.control.grip import Grip
from preshape.control.grips import (
    BRACE_X,
    BRACE_Y,
    CAP_Z,
    CLAMP_WIDTHS,
    FACE_X,
    GRASP_WIDTHS,
    INSERT_X,
    brace_grip,
    cage_grip,
)
from preshape.hal.layout import LAYOUT, SIDES, Side
from preshape.hal.sah_hand import ACTUATED, FINGERS
from preshape.hal.transform import Matrix, inverse
from preshape.hal.world import Face, face_normal
from preshape.planner.hand_kinematics import hand_kinematics

SIZE = np.array([0.06, 0.09, 0.20])
ENDS: tuple[Face, ...] = ("+z", "-z")
CAGES: list[tuple[Face, Face, Side]] = list(product(ENDS, ("+y", "-y"), SIDES))
BRACES: list[tuple[Face, Face, Side]] = list(product(ENDS, ("+x", "-x"), SIDES))


def all_grips() -> list[tuple[Grip, Face]]:
    cages = [(cage_grip(SIZE, end, face, side), end) for end, face, side in CAGES]
    return cages + [(brace_grip(SIZE, end, face, side), end) for end, face, side in BRACES]


def corners_in_palm(X_box_palm: Matrix) -> Matrix:
    """Return the box's 8 corners (8, 3) in the palm's frame, m."""
    corners = np.array(list(product(*[(-s / 2, s / 2) for s in SIZE])))
    X = inverse(X_box_palm)
    return corners @ X[:3, :3].T + X[:3, 3]


def face_in_palm(X_box_palm: Matrix, face: Face) -> tuple[Matrix, Matrix]:
    """Return a face's centre (m) and outward normal in the palm's frame."""
    X, n = inverse(X_box_palm), face_normal(face)
    return X[:3, :3] @ (n * np.abs(n) @ SIZE / 2 * np.abs(n)) + X[:3, 3], X[:3, :3] @ n


@pytest.mark.parametrize(("grip", "end"), all_grips())
def test_the_end_cap_lies_before_the_palm_and_the_box_beyond_it(grip: Grip, end: Face) -> None:
    for X in (grip.X_box_palm, grip.X_box_palm_insert):
        assert np.linalg.det(X[:3, :3]) == pytest.approx(1.0)
        np.testing.assert_allclose(X[:3, :3].T @ X[:3, :3], np.eye(3), atol=1e-12)
        z = np.sort(corners_in_palm(X)[:, 2])
        np.testing.assert_allclose(z, [CAP_Z] * 4 + [CAP_Z + SIZE[2]] * 4, atol=1e-12)
        center, normal = face_in_palm(X, end)
        assert center[2] == pytest.approx(CAP_Z)
        np.testing.assert_allclose(normal, [0, 0, -1], atol=1e-12)


@pytest.mark.parametrize(("grip", "end"), all_grips())
def test_the_grasped_faces_lie_between_fingers_and_thumb(grip: Grip, end: Face) -> None:
    kinematics = hand_kinematics(grip.side)
    tips = kinematics.tips(np.where(np.isfinite(grip.preshape), grip.preshape, 0.0))[0]
    thumb = tips[FINGERS.index("thumb"), 0]
    held_x = BRACE_X if grip.name == "brace" else FACE_X
    for X, face_x in ((grip.X_box_palm, held_x), (grip.X_box_palm_insert, INSERT_X)):
        x = corners_in_palm(X)[:, 0]
        np.testing.assert_allclose(x.min(), face_x, atol=1e-12)
        np.testing.assert_allclose(x.max() - x.min(), SIZE[1], atol=1e-12)
        for finger in ("fore", "middle", "ring"):
            assert tips[FINGERS.index(finger), 0] < x.min()
    insert = corners_in_palm(grip.X_box_palm_insert)[:, 0]
    assert thumb > insert.max()


@pytest.mark.parametrize(("end", "face", "side"), CAGES)
def test_a_cage_has_its_finger_face_at_the_fingers_and_the_box_amid_fore_and_ring(
    end: Face, face: Face, side: Side
) -> None:
    grip = cage_grip(SIZE, end, face, side)
    center, normal = face_in_palm(grip.X_box_palm, face)
    np.testing.assert_allclose(normal, [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(center[:2], [FACE_X, 0.0], atol=1e-12)


@pytest.mark.parametrize(("end", "opening", "side"), BRACES)
def test_a_brace_leaves_the_opening_free_and_has_the_ring_behind_the_opposite_face(
    end: Face, opening: Face, side: Side
) -> None:
    grip = brace_grip(SIZE, end, opening, side)
    _, normal = face_in_palm(grip.X_box_palm, opening)
    mirror = 1.0 if side == "right" else -1.0
    np.testing.assert_allclose(normal, [0, mirror, 0], atol=1e-12)
    y = corners_in_palm(grip.X_box_palm)[:, 1]
    assert 0.5 * (y.max() + y.min()) == pytest.approx(mirror * BRACE_Y)
    tips = hand_kinematics(side).tips(grip.preshape)[0]
    assert tips[FINGERS.index("ring"), 1] * mirror < (y * mirror).min()
    for finger in ("fore", "middle"):
        assert y.min() < tips[FINGERS.index(finger), 1] < y.max()


@pytest.mark.parametrize("back_m", [0.0, 0.01, 0.02])
def test_a_brace_stays_back_by_what_it_is_told(back_m: float) -> None:
    near, far = brace_grip(SIZE, "+z", "+x", "left"), brace_grip(SIZE, "+z", "+x", "left", back_m)
    for a, b in ((near.X_box_palm, far.X_box_palm), (near.X_box_palm_insert, far.X_box_palm_insert)):
        np.testing.assert_allclose(b[:3, 3] - a[:3, 3], -back_m * a[:3, 2], atol=1e-12)


@pytest.mark.parametrize(("grip", "end"), all_grips())
def test_angles_and_torques_are_within_the_limits_and_opposed_fingers_both_press(grip: Grip, end: Face) -> None:
    hand = LAYOUT.hand(grip.side)
    for angles in (grip.preshape, *(stage.angles for stage in grip.stages)):
        named = np.isfinite(angles)
        assert np.all(angles[named] >= LAYOUT.lower[hand][named] - 1e-9)
        assert np.all(angles[named] <= LAYOUT.upper[hand][named] + 1e-9)
    assert np.isfinite(grip.preshape).all()
    for torques in (grip.torques, *(stage.torques for stage in grip.stages)):
        assert np.nanmax(np.abs(np.append(torques, 0.0)) - np.append(LAYOUT.torque[hand], 0.0)) <= 0.0
    np.testing.assert_array_equal(grip.stages[-1].torques, grip.torques)
    assert grip.stages[0].touch
    for pair in grip.opposed:
        for finger in pair:
            names = [name for name in ACTUATED if name.startswith(finger)]
            assert any(np.isfinite(grip.torques[ACTUATED.index(name)]) for name in names)


@pytest.mark.parametrize("width", [GRASP_WIDTHS[0] - 1e-4, GRASP_WIDTHS[1] + 1e-4])
def test_widths_between_thumb_and_fingers_out_of_range_are_refused_with_both_figures(width: float) -> None:
    size = np.array([0.06, width, 0.20])
    for make in (lambda: cage_grip(size, "+z", "+y", "right"), lambda: brace_grip(size, "+z", "+x", "left")):
        with pytest.raises(ValueError, match=rf"got {width:g} m, allowed is 0\.07 \.\. 0\.1 m"):
            make()


@pytest.mark.parametrize("width", [CLAMP_WIDTHS[0] - 1e-4, CLAMP_WIDTHS[1] + 1e-4])
def test_a_cage_refuses_what_fore_and_ring_do_not_clamp_and_a_brace_does_not_care(width: float) -> None:
    size = np.array([width, 0.09, 0.20])
    with pytest.raises(ValueError, match="width between fore and ring finger"):
        cage_grip(size, "+z", "+y", "right")
    assert brace_grip(size, "+z", "+x", "left").name == "brace"


def test_a_box_between_fingers_that_spread_no_further_is_refused_and_not_crushed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(grips, "CLAMP_WIDTHS", (0.05, 0.07))
    with pytest.raises(ValueError, match=r"fore_abd: fore stands 1\.0 mm inside the box before it closes"):
        cage_grip(np.array([0.065, 0.095, 0.22]), "+z", "+y", "right")


def test_a_brace_refuses_an_opening_on_an_end_cap() -> None:
    with pytest.raises(ValueError, match="perpendicular to"):
        brace_grip(SIZE, "+z", "-z", "left")
