"""Laws of the software renderer, held against closed-form geometry."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from preshape.hal.transform import exp_so3, inverse, transform
from preshape.tools import raster_kernels as kernels
from preshape.tools.raster import Camera, look_at, pixel_window, project, render
from preshape.tools.scene_view import shapes_of
from preshape.tools.shape import Kind, Shape, convex_body, segment

RED = (1.0, 0.0, 0.0)
BLUE = (0.0, 0.0, 1.0)
KINDS: tuple[Kind, ...] = ("box", "capsule", "cylinder", "ellipsoid")
HITS = {
    "box": kernels.hit_box, "capsule": kernels.hit_capsule,
    "cylinder": kernels.hit_cylinder, "ellipsoid": kernels.hit_ellipsoid,
}  # fmt: skip


def distance_outside(kind: str, p: np.ndarray, size: np.ndarray) -> float:
    """Return a function of p that is < 0 inside a shape, 0 on its surface and > 0 outside."""
    if kind == "box":
        return float(np.max(np.abs(p) - size))
    if kind == "ellipsoid":
        return float(np.sum((p / size) ** 2) - 1.0)
    if kind == "cylinder":
        return float(max(np.hypot(p[0], p[1]) - size[0], abs(p[2]) - size[1]))
    return float(np.linalg.norm(p - [0.0, 0.0, np.clip(p[2], -size[1], size[1])]) - size[0])


@pytest.mark.parametrize("kind", HITS)
def test_ray_enters_where_the_surface_is_first_met(kind: str) -> None:
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(300):
        size = rng.uniform(0.05, 0.3, 3)
        o = rng.normal(size=3)
        o *= 1.5 / np.linalg.norm(o)
        d = rng.uniform(-0.3, 0.3, 3) - o
        normal = np.zeros(3)
        t, _ = HITS[kind](o, d, size, normal)
        samples = np.array([distance_outside(kind, o + s * d, size) for s in np.linspace(0.0, 2.0, 400)])
        if t < 0:
            assert samples.min() > -1e-3
            continue
        hits += 1
        assert abs(distance_outside(kind, o + t * d, size)) < 1e-9
        assert samples[np.linspace(0.0, 2.0, 400) < t].min() > -1e-9
        step = 1e-6
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-9)
        assert normal @ d <= 1e-9
        assert distance_outside(kind, o + t * d + step * normal, size) > 0
        assert distance_outside(kind, o + t * d - step * normal, size) < 0
    assert hits > 50


def test_nearer_shape_hides_the_farther_whatever_the_order() -> None:
    near = Shape("box", transform((0.0, 0.0, 0.0)), np.full(3, 0.1), RED)
    far = Shape("box", transform((0.0, 1.0, 0.0)), np.full(3, 0.1), BLUE)
    camera = look_at((0.0, -2.0, 0.0), (0.0, 0.0, 0.0))
    for shapes in ([near, far], [far, near]):
        pixel = render(shapes, camera, 64, 48)[24, 32]
        assert pixel[0] > 50
        assert pixel[2] == 0
    assert np.array_equal(render([near, far], camera, 64, 48), render([far, near], camera, 64, 48))


def test_sphere_is_drawn_where_its_centre_projects_and_as_large_as_its_angle() -> None:
    rng = np.random.default_rng(5)
    for _ in range(10):
        eye = rng.normal(size=3)
        eye *= 2.0 / np.linalg.norm(eye)
        camera = look_at(eye, (0.0, 0.0, 0.0))
        red = render([Shape("ellipsoid", np.eye(4), np.full(3, 0.2), RED, flat=True)], camera, 200, 160)[..., 2] == 0
        rows, columns = np.nonzero(red)
        column, row, depth = project([[0.0, 0.0, 0.0]], camera, 200, 160)[0]
        assert depth == pytest.approx(2.0)
        assert (columns.mean() + 0.5, rows.mean() + 0.5) == pytest.approx((column, row), abs=0.6)
        radius = 160 / 2 / np.tan(0.35) * np.tan(np.arcsin(0.1))
        assert np.sqrt(red.sum() / np.pi) == pytest.approx(radius, rel=0.06)


def test_convex_body_of_a_boxs_corners_looks_like_the_box() -> None:
    rng = np.random.default_rng(11)
    for _ in range(5):
        half = rng.uniform(0.05, 0.2, 3)
        X = transform(rng.uniform(-0.2, 0.2, 3), exp_so3(rng.normal(size=3)))
        corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * half
        body = convex_body(corners, X, RED)
        assert len(body.planes) == 6
        camera = look_at((1.2, 0.4, 0.5), (0.0, 0.0, 0.0))
        same = render([body], camera, 120, 90) == render([Shape("box", X, half, RED)], camera, 120, 90)
        assert same.mean() > 0.999


def test_pixel_window_holds_every_pixel_of_a_shape() -> None:
    rng = np.random.default_rng(7)
    for kind in KINDS:
        for _ in range(10):
            X = transform(rng.uniform(-0.3, 0.3, 3), exp_so3(rng.normal(size=3)))
            shape = Shape(kind, X, rng.uniform(0.05, 0.2, 3), RED)
            camera = look_at((1.5, 0.2, 0.4), (0.0, 0.0, 0.0))
            image = render([shape], camera, 120, 90, samples=1)
            empty = render([], camera, 120, 90, samples=1)
            rows, columns = np.nonzero(np.any(image != empty, axis=2))
            focal = 90 / 2 / np.tan(camera.height_angle / 2)
            left, right, top, bottom = pixel_window(shape.half(), inverse(camera.X_world_camera) @ X, focal, 120, 90)
            assert left <= columns.min() and columns.max() < right
            assert top <= rows.min() and rows.max() < bottom


def test_edges_are_drawn_darker_than_the_faces_beside_them() -> None:
    box = Shape("box", np.eye(4), np.full(3, 0.2), (1.0, 1.0, 1.0))
    image = render([box], look_at((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)), 200, 160, samples=1)
    assert image[79:82, 99:102].max(2).min() < 80, "the corner nearest to the camera is in the middle"
    assert image[60, 100].min() > 120
    assert image[100, 80].min() > 100
    assert image[100, 120].min() > 100


def test_flat_shapes_keep_their_plain_colour() -> None:
    image = render([segment((0, 0, -1), (0, 0, 1), 0.2, (0.0, 1.0, 0.0))], look_at((2, 0, 0), (0, 0, 0)), 64, 48)
    assert tuple(image[24, 32]) == (0, 255, 0)


def test_shape_behind_the_camera_is_not_drawn() -> None:
    camera = look_at((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    behind = Shape("box", transform((-1.0, 0.0, 0.0)), np.full(3, 0.2), RED)
    assert np.array_equal(render([behind], camera, 32, 24), render([], camera, 32, 24))


def test_floor_that_passes_under_the_camera_is_drawn() -> None:
    floor = Shape("box", transform((0.0, 0.0, -1.0)), np.array([5.0, 5.0, 0.01]), RED)
    image = render([floor], Camera(look_at((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)).X_world_camera, 1.2), 64, 48)
    assert image[-1, 32, 2] == 0
    assert image[0, 32, 2] > 0


def test_every_visible_geom_of_a_scene_becomes_one_shape() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='plane' size='0 0 1'/><geom type='sphere' size='.1' rgba='1 0 0 1'/>"
        "<body pos='1 2 3'><geom type='capsule' size='.1 .2'/><geom type='box' size='.1 .2 .3' group='3'/></body>"
        "<geom type='cylinder' size='.1 .2' rgba='1 1 1 0'/></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    shapes = shapes_of(model, data)
    assert [shape.kind for shape in shapes] == ["box", "ellipsoid", "capsule"]
    assert shapes[1].color == (1.0, 0.0, 0.0)
    assert np.allclose(shapes[2].X_world_shape[:3, 3], [1.0, 2.0, 3.0])
