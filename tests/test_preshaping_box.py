"""Laws of the preshaping box, the number of fingers and the fingertip targets."""

from itertools import product

import numpy as np
import pytest

from preshape.hal.layout import SIDES, Side
from preshape.hal.world import FACES, Face, face_normal
from preshape.planner.finger_count import RING_GAP_MIN, TIP_SIDE, fingers_for, tip_targets
from preshape.planner.grasping_plane import grasping_plane
from preshape.planner.preshaping_box import box_from_component
from preshape.planner.span import can_span, widest_gap

TEA = np.array([0.06, 0.09, 0.20]) / 2
PAIRS = [(palm, thumb) for palm, thumb in product(FACES, FACES) if palm[1] != thumb[1]]


@pytest.mark.parametrize(("palm", "thumb"), PAIRS)
def test_axes_point_from_palm_to_face_and_from_fingers_to_thumb(palm: Face, thumb: Face) -> None:
    box = box_from_component(palm, thumb, -TEA, TEA, margin=0.01, reach=1.0)
    R = box.X_object_pb[:3, :3]
    np.testing.assert_array_equal(R[:, 2], -face_normal(palm))
    np.testing.assert_array_equal(R[:, 0], face_normal(thumb))
    np.testing.assert_allclose(R.T @ R, np.eye(3))
    assert np.linalg.det(R) == pytest.approx(1.0)


@pytest.mark.parametrize(("palm", "thumb"), PAIRS)
def test_only_the_edge_between_the_preshape_faces_grows_by_the_margin(palm: Face, thumb: Face) -> None:
    lower, upper = np.array([-0.03, -0.045, 0.033]), np.array([0.03, 0.045, 0.10])
    plain = box_from_component(palm, thumb, lower, upper, margin=0.0, reach=1.0)
    grown = box_from_component(palm, thumb, lower, upper, margin=0.015, reach=1.0)
    np.testing.assert_allclose(grown.half - plain.half, [0.015, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(grown.X_object_pb, plain.X_object_pb)
    np.testing.assert_allclose(np.abs(plain.X_object_pb[:3, :3]) @ plain.half, (upper - lower) / 2, atol=1e-15)
    np.testing.assert_allclose(plain.X_object_pb[:3, 3], (upper + lower) / 2, atol=1e-15)
    assert grown.grasped_width == pytest.approx(2 * plain.half[0])


@pytest.mark.parametrize(("palm", "thumb"), PAIRS)
def test_a_long_z_edge_is_cut_at_the_palms_end(palm: Face, thumb: Face) -> None:
    box = box_from_component(palm, thumb, -TEA, TEA, reach=0.02)
    near = box.X_object_pb @ np.array([0.0, 0.0, -box.half[2], 1.0])
    assert box.depth == pytest.approx(0.02)
    assert near[:3] @ face_normal(palm) == pytest.approx(TEA["xyz".index(palm[1])])


def test_impossible_components_are_refused() -> None:
    with pytest.raises(ValueError, match="different axes"):
        box_from_component("+x", "-x", -TEA, TEA)
    with pytest.raises(ValueError, match="upper > lower"):
        box_from_component("+z", "-x", TEA, -TEA)
    with pytest.raises(ValueError, match="margin"):
        box_from_component("+z", "-x", -TEA, TEA, margin=-0.001)


def test_fingers_follow_the_size_of_the_box() -> None:
    assert fingers_for([0.03, 0.012, 0.03]) == ("thumb", "fore")
    assert fingers_for([0.04, 0.0335, 0.03]) == ("thumb", "fore", "middle")  # a lying tea box's end section
    assert fingers_for([0.04, 0.045, 0.03]) == ("thumb", "fore", "middle")
    assert fingers_for([0.04, 0.060, 0.03]) == ("thumb", "fore", "middle", "ring")


def test_the_ring_meets_the_thumb_only_across_a_wide_gap() -> None:
    for x in np.linspace(0.001, 0.08, 40):
        if "ring" in fingers_for([x, 0.075, 0.03]):
            assert 2 * (x + TIP_SIDE) > RING_GAP_MIN


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("y", [0.012, 0.0335, 0.045, 0.070])
def test_grasping_plane_of_the_targets_has_the_boxs_pose(side: Side, y: float) -> None:
    half = np.array([0.042, y, 0.033])
    targets = tip_targets(half, fingers_for(half), side)
    np.testing.assert_allclose(grasping_plane(targets, side, [0, 1, 0]), np.eye(4), atol=1e-12)


@pytest.mark.parametrize("side", SIDES)
def test_fingertip_surfaces_touch_the_preshape_faces(side: Side) -> None:
    half = np.array([0.05, 0.07, 0.03])
    targets = tip_targets(half, fingers_for(half), side)
    np.testing.assert_allclose(np.abs(targets[:, 0]) - TIP_SIDE, half[0])
    assert targets[0, 0] > 0 > targets[1:, 0].max()


def test_wider_than_the_widest_gap_no_hand_spans() -> None:
    fingers = ("thumb", "fore", "middle")
    gap = widest_gap(fingers)
    assert 0.10 < gap < 0.25
    for width, spans in ((gap - 0.002, True), (gap + 0.002, False)):
        half = np.array([width / 2, 0.045, 0.05])
        box = box_from_component("+z", "+x", -half, half, margin=0.0)
        assert can_span(box, fingers) is spans
