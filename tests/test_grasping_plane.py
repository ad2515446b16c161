"""Laws of the grasping plane and of both force closure tests."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from preshape.hal.layout import SIDES, Side
from preshape.hal.transform import exp_so3, transform
from preshape.planner.force_closure import cone_wrenches, ferrari_canny, force_closure, line_margin
from preshape.planner.grasping_plane import grasping_plane

THREE = np.array([[0.03, 0.0, 0.0], [-0.03, 0.02, 0.0], [-0.03, -0.02, 0.0]])
FOUR = np.array([[0.03, 0.0, 0.0], [-0.03, 0.04, -0.002], [-0.03, 0.0, 0.004], [-0.03, -0.04, -0.002]])
INWARD_3 = np.array([[-1.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]])


@pytest.mark.parametrize("tips", [THREE, FOUR, THREE[:2]])
def test_plane_moves_with_the_fingertips(tips: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        X = transform(rng.normal(size=3), exp_so3(rng.normal(size=3)))
        moved = tips @ X[:3, :3].T + X[:3, 3]
        at_rest = grasping_plane(tips, "right", [0, 1, 0])
        np.testing.assert_allclose(grasping_plane(moved, "right", X[:3, 1]), X @ at_rest, atol=1e-9)


@pytest.mark.parametrize("side", SIDES)
def test_plane_is_a_right_handed_frame_with_x_towards_the_thumb(side: Side) -> None:
    rng = np.random.default_rng(1)
    for n in (2, 3, 4):
        for _ in range(50):
            tips = rng.normal(size=(n, 3))
            X = grasping_plane(tips, side)
            np.testing.assert_allclose(X[:3, :3].T @ X[:3, :3], np.eye(3), atol=1e-9)
            assert np.linalg.det(X[:3, :3]) == pytest.approx(1.0)
            assert X[:3, 0] @ (tips[0] - tips[1:].mean(axis=0)) >= 0


def test_coinciding_fingertips_are_refused() -> None:
    with pytest.raises(ValueError, match="coincide"):
        grasping_plane(np.zeros((3, 3)), "right")
    with pytest.raises(ValueError, match="2 to 4"):
        grasping_plane(np.zeros((5, 3)), "right")


def test_line_passes_the_segment_only_between_its_ends() -> None:
    for y in np.linspace(-0.04, 0.04, 33):
        tips = THREE.copy()
        tips[0, 1] = y
        assert line_margin(tips, "right") == pytest.approx(0.02 - abs(y), abs=1e-12)


def test_line_passes_the_triangle_only_inside_it() -> None:
    rng = np.random.default_rng(2)
    triangle = FOUR[1:, 1:]
    for _ in range(300):
        tips = FOUR.copy()
        tips[0, 1:] = rng.uniform([-0.06, -0.01], [0.06, 0.01])
        weights = np.linalg.solve(np.vstack([triangle.T, np.ones(3)]), [*tips[0, 1:], 1.0])
        assert (line_margin(tips, "right") > 0) == bool(np.all(weights > 0))


def test_metric_equals_the_smallest_offset_of_the_wrench_hull() -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        tips = THREE + rng.normal(scale=0.004, size=(3, 3))
        wrenches = cone_wrenches(tips, INWARD_3, rng.uniform(0.2, 0.9), tips.mean(axis=0), 0.04)
        reference = -ConvexHull(wrenches, qhull_options="QJ").equations[:, -1].max()
        assert ferrari_canny(wrenches) == pytest.approx(reference, abs=1e-6)


def test_metric_grows_with_friction() -> None:
    values = [force_closure(THREE, THREE, INWARD_3, mu, "right").epsilon for mu in (0.1, 0.2, 0.4, 0.8)]
    assert all(a < b for a, b in zip(values, values[1:], strict=False))
    assert values[0] > 0


def test_cones_refuse_what_the_line_cannot_see() -> None:
    # The line test knows no normals: pulling contacts pass it, and hold nothing.
    pulling = force_closure(THREE, THREE, -INWARD_3 * [[1.0], [-1.0], [-1.0]], 0.5, "right")
    assert pulling.by_line
    assert not pulling.by_cones


def test_two_point_contacts_cannot_resist_a_turn_about_their_line() -> None:
    tips, inward = THREE[:2] * [1, 0, 1], INWARD_3[:2]
    assert force_closure(tips, tips, inward, 0.5, "right").epsilon == 0.0
    soft = force_closure(tips, tips, inward, 0.5, "right", torsion=0.003)
    assert soft.by_cones
    assert soft.by_line
