"""Laws of convex hulls, convex parts and their minimum boxes."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from preshape.hal.transform import exp_so3, transform
from preshape.planner.convex_hull import convex_hull
from preshape.planner.parts import Part, box_part, cylinder_part, l_carton_parts, mesh_part, minimum_box

POSES = [transform(p, exp_so3(w)) for p, w in np.random.default_rng(0).normal(scale=0.4, size=(6, 2, 3))]


def _inside(part: Part, tolerance: float = 1e-9) -> bool:
    box = minimum_box(part)
    local = (part.vertices - box.X_object_box[:3, 3]) @ box.X_object_box[:3, :3]
    return bool(np.all(np.abs(local) <= box.half + tolerance))


@pytest.mark.parametrize("d", [2, 3, 4, 6])
def test_hull_equals_qhull(d: int) -> None:
    rng = np.random.default_rng(d)
    for n in (d + 1, d + 5, 40):
        points = rng.normal(size=(n, d))
        hull, reference = convex_hull(points), ConvexHull(points)
        assert hull is not None
        assert set(hull.vertices.tolist()) == set(reference.vertices.tolist())
        assert len(hull.facets) == len(reference.simplices)
        assert float((hull.normals @ points.T - hull.offsets[:, None]).max()) < 1e-7


def test_flat_points_have_no_hull() -> None:
    flat = np.random.default_rng(1).normal(size=(20, 3)) * [1, 1, 0]
    assert convex_hull(flat) is None
    with pytest.raises(ValueError, match="no volume"):
        mesh_part("sheet", flat)


@pytest.mark.parametrize("X", POSES)
def test_minimum_box_of_a_box_is_the_box(X: np.ndarray) -> None:
    size = np.array([0.06, 0.09, 0.20])
    box = minimum_box(box_part("tea", size, X))
    np.testing.assert_allclose(np.sort(box.half), size / 2, atol=1e-8)
    np.testing.assert_allclose(box.X_object_box[:3, 3], X[:3, 3], atol=1e-8)


def test_axes_are_named_like_the_objects() -> None:
    box = minimum_box(box_part("tea", (0.06, 0.09, 0.20)))
    np.testing.assert_allclose(box.X_object_box, np.eye(4), atol=1e-6)
    np.testing.assert_allclose(box.half, [0.03, 0.045, 0.10], atol=1e-8)


@pytest.mark.parametrize("X", POSES)
def test_minimum_box_of_a_cylinder_is_as_wide_as_it(X: np.ndarray) -> None:
    part = cylinder_part("can", 0.03, 0.2, X)
    np.testing.assert_allclose(minimum_box(part).half, [0.03, 0.03, 0.10], atol=1e-6)
    assert _inside(part)


def test_prism_contains_its_cylinder() -> None:
    ring = cylinder_part("can", 0.03, 0.2).vertices
    assert np.linalg.norm(ring[:, :2], axis=1).min() > 0.03


def test_minimum_box_of_a_tetrahedron_is_a_cube_on_its_edges() -> None:
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
    assert minimum_box(mesh_part("tetrahedron", corners)).volume == pytest.approx(8.0)


def test_minimum_box_beats_random_boxes_and_holds_its_part() -> None:
    rng = np.random.default_rng(2)
    for n in (5, 9, 30, 80):
        part = mesh_part("stone", rng.normal(size=(n, 3)))
        box = minimum_box(part)
        assert _inside(part)
        turned = [part.vertices @ exp_so3(rng.normal(scale=1.5, size=3)) for _ in range(3000)]
        assert box.volume <= min(float(np.prod(np.ptp(points, axis=0))) for points in turned) * (1 + 1e-9)


def test_l_carton_fills_its_outer_size_but_for_one_corner() -> None:
    size, arm = np.array([0.12, 0.06, 0.20]), 0.05
    upright, foot = l_carton_parts(size, arm)
    both = np.vstack([upright.vertices, foot.vertices])
    np.testing.assert_allclose(both.max(axis=0), size / 2)
    np.testing.assert_allclose(both.min(axis=0), -size / 2)
    volume = sum(minimum_box(part).volume for part in (upright, foot))
    assert volume == pytest.approx(np.prod(size) - (0.12 - arm) * 0.06 * (0.20 - arm), rel=1e-6)


def test_bad_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="size"):
        box_part("b", (0.1, -0.1, 0.1))
    with pytest.raises(ValueError, match="radius"):
        cylinder_part("c", 0.0, 0.1)
    with pytest.raises(ValueError, match="arm"):
        l_carton_parts((0.1, 0.1, 0.1), 0.2)
