"""The camera as a sensor of the scene: its image cast ray by ray, without a graphics library.

Every machine sees the same pixels: intersection by `mj_multiRay`, print from the face textures, shade from the
surface's normal, then the lens (blur, vignetting) and the sensor (noise, quantisation).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from preshape.hal.box_face import face_frame
from preshape.hal.transform import Matrix, inverse
from preshape.hal.world import FACES, CameraModel, Face
from preshape.sim_backend.texture import PIXELS_PER_M

LIGHT = np.array([-0.45, 0.25, 0.86])
"""Direction towards the lamp, in the world's frame."""
AMBIENT, DIFFUSE = 0.62, 0.36
BACKGROUND = 46.0
"""Grey level of what no geom covers."""
BARE_PAPER = 168.0
"""Grey level of the box's unprinted inside."""
VIGNETTING = 0.22
"""Share of light lost in the image's corners."""
NOISE = 2.5
"""Standard deviation of the sensor's noise, grey levels."""
SKIN_M = 0.0015
"""How far from a face's plane a hit still counts as on its printed side, m."""
HIDDEN_GROUP = 4
"""Geoms of this group (the box's content) are not seen."""


@dataclass(frozen=True, slots=True)
class Window:
    """A rectangle of an image: first and one past the last row and column."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.bottom - self.top, self.right - self.left


def pixel_rays(camera: CameraModel, window: Window) -> Matrix:
    """Return unit ray directions (rows * columns, 3) in the camera's frame through the pixels' centres."""
    column = (np.arange(window.left, window.right) + 0.5 - camera.width / 2) / camera.focal_px
    row = (np.arange(window.top, window.bottom) + 0.5 - camera.height / 2) / camera.focal_px
    rays = np.ones((*window.shape, 3))
    rays[..., 0], rays[..., 1] = column[None, :], row[:, None]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return rays.reshape(-1, 3)


def whole(camera: CameraModel) -> Window:
    """Return the window of the whole image."""
    return Window(0, camera.height, 0, camera.width)


def window_around(camera: CameraModel, X_world_box: Matrix, size: Matrix, margin_m: float = 0.03) -> Window:
    """Return the window in which a box is expected, grown by a margin (m at the box's distance).

    Empty (no rows, no columns) when no part of it is in the image; the whole image when it reaches behind the camera.
    """
    corners = (np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T * size) @ X_world_box[:3, :3].T + X_world_box[
        :3, 3
    ]
    X_camera_world = inverse(camera.X_world_camera)
    p = corners @ X_camera_world[:3, :3].T + X_camera_world[:3, 3]
    if np.min(p[:, 2]) < 0.05:
        return whole(camera)
    pixels = p[:, :2] / p[:, 2:] * camera.focal_px + np.array([camera.width, camera.height]) / 2
    margin = margin_m * camera.focal_px / np.min(p[:, 2])
    left, top = np.floor(np.min(pixels, axis=0) - margin)
    right, bottom = np.ceil(np.max(pixels, axis=0) + margin)
    columns = np.clip([left, right], 0, camera.width).astype(int)
    rows = np.clip([top, bottom], 0, camera.height).astype(int)
    return Window(int(rows[0]), int(rows[1]), int(columns[0]), int(columns[1]))


@dataclass(frozen=True, slots=True, eq=False)
class BoxSurface:
    """Which geoms are the printed box: for each its body, and X_box_body with lid and tab shut; the box's size."""

    root: int
    geom_body: Mapping[int, int]
    X_box_body: Mapping[int, Matrix]
    size: Matrix


def box_surface(model: mujoco.MjModel, size: Matrix, body: str = "box") -> BoxSurface:
    """Return the printed surface made of all geoms of a body and of the bodies hinged on it."""
    root = model.body(body).id
    rest: dict[int, Matrix] = {root: np.eye(4)}
    for child in range(root + 1, model.nbody):
        if int(model.body_parentid[child]) in rest:
            X = np.eye(4)
            rotation = np.zeros(9)
            mujoco.mju_quat2Mat(rotation, model.body_quat[child])
            X[:3, :3], X[:3, 3] = rotation.reshape(3, 3), model.body_pos[child]
            rest[child] = rest[int(model.body_parentid[child])] @ X
    geoms = {g: int(model.geom_bodyid[g]) for g in range(model.ngeom) if int(model.geom_bodyid[g]) in rest}
    return BoxSurface(root, geoms, rest, np.array(size, float))


class SceneCamera:
    """Casts images of a MuJoCo scene; the box's geoms carry the given textures."""

    def __init__(
        self, model: mujoco.MjModel, surface: BoxSurface, textures: Mapping[Face, NDArray[np.uint8]], seed: int = 0
    ) -> None:
        """Prepare lookups; `seed` sets the noise of all images taken."""
        self._model = model
        self._surface = surface
        self._frames = {face: face_frame(surface.size, face) for face in FACES}
        self._textures = {face: textures[face].astype(np.float32) for face in FACES}
        self._seed = seed
        self._grey = (model.geom_rgba[:, :3] @ np.array([0.299, 0.587, 0.114]) * 255.0).astype(np.float64)
        self._groups = np.array([group != HIDDEN_GROUP for group in range(6)], dtype=np.uint8)
        self._taken = 0

    def cast(self, data: mujoco.MjData, camera: CameraModel, window: Window | None = None) -> NDArray[np.uint8]:
        """Return the image (height, width), with zeros outside the window; needs `data`'s positions up to date."""
        window = window or whole(camera)
        image = np.zeros((camera.height, camera.width), np.uint8)
        rows, cols = window.shape
        if rows > 0 and cols > 0:
            light = self._radiance(data, camera, window).reshape(rows, cols)
            rng = np.random.default_rng((0xCA3E, self._seed, self._taken))
            light = _blur(light) * _vignette(camera, window) + NOISE * rng.standard_normal(
                (rows, cols), dtype=np.float32
            )
            image[window.top : window.bottom, window.left : window.right] = np.clip(np.rint(light), 1, 255).astype(
                np.uint8
            )
        self._taken += 1
        return image

    def _radiance(self, data: mujoco.MjData, camera: CameraModel, window: Window) -> Matrix:
        origin = camera.X_world_camera[:3, 3]
        rays = pixel_rays(camera, window) @ camera.X_world_camera[:3, :3].T
        count = len(rays)
        geom, distance, normal = np.empty(count, np.int32), np.empty(count), np.empty(3 * count)
        mujoco.mj_multiRay(
            self._model,
            data,
            origin,
            rays.ravel(),
            self._groups,
            True,
            -1,
            geom,
            distance,
            normal,
            count,
            mujoco.mjMAXVAL,
        )
        normal = normal.reshape(-1, 3)
        hit = geom >= 0
        albedo = np.where(hit, self._grey[geom], BACKGROUND)
        for body, X_box_body in self._surface.X_box_body.items():
            members = [g for g, of in self._surface.geom_body.items() if of == body]
            on_body = np.flatnonzero(np.isin(geom, members))
            if len(on_body):
                R_world_body, p_world_body = data.xmat[body].reshape(3, 3), data.xpos[body]
                points = (origin + rays[on_body] * distance[on_body, None] - p_world_body) @ R_world_body
                albedo[on_body] = self._print(
                    points @ X_box_body[:3, :3].T + X_box_body[:3, 3],
                    normal[on_body] @ R_world_body @ X_box_body[:3, :3].T,
                )
        shade = AMBIENT + DIFFUSE * np.maximum(normal @ (LIGHT / np.linalg.norm(LIGHT)), 0.0)
        return np.where(hit, albedo * shade, albedo)

    def _print(self, p_box: Matrix, n_box: Matrix) -> Matrix:
        """Return the print (n,) at points and normals (n, 3) in the shut box's frame; bare paper inside the box."""
        grey = np.full(len(p_box), BARE_PAPER)
        axis = np.argmax(np.abs(n_box), axis=1)
        positive = np.take_along_axis(n_box, axis[:, None], 1)[:, 0] > 0
        for number, face in enumerate(FACES):
            facing = np.flatnonzero((axis == number // 2) & (positive == (number % 2 == 0)))
            p_face = p_box[facing] @ self._frames[face].X_box_face[:3, :3] - self._depth(face)
            outer = facing[np.abs(p_face[:, 2]) < SKIN_M]
            grey[outer] = _sample(self._textures[face], p_face[np.abs(p_face[:, 2]) < SKIN_M, :2])
        return grey

    def _depth(self, face: Face) -> Matrix:
        X = self._frames[face].X_box_face
        return X[:3, 3] @ X[:3, :3]


def _sample(texture: NDArray[np.float32], uv: Matrix) -> Matrix:
    """Return a texture's values at face coordinates (n, 2), m, by bilinear interpolation."""
    rows, cols = texture.shape
    col = np.clip(uv[:, 0] * PIXELS_PER_M + cols / 2 - 0.5, 0, cols - 1.001)
    row = np.clip(rows / 2 - 0.5 - uv[:, 1] * PIXELS_PER_M, 0, rows - 1.001)
    r, c = row.astype(int), col.astype(int)
    a, b = row - r, col - c
    upper = (1 - b) * texture[r, c] + b * texture[r, c + 1]
    lower = (1 - b) * texture[r + 1, c] + b * texture[r + 1, c + 1]
    return (1 - a) * upper + a * lower


def _blur(light: Matrix) -> Matrix:
    """Return the picture behind the lens: a separable [1 2 1] / 4 kernel, borders repeated."""
    padded = np.pad(light, 1, mode="edge")
    across = (padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:]) / 4
    return (across[:-2] + 2 * across[1:-1] + across[2:]) / 4


def _vignette(camera: CameraModel, window: Window) -> Matrix:
    """Return the share of light that reaches each pixel: 1 - k r^2, r = 1 in the image's corner."""
    x = np.arange(window.left, window.right) + 0.5 - camera.width / 2
    y = np.arange(window.top, window.bottom) + 0.5 - camera.height / 2
    r2 = (x[None, :] ** 2 + y[:, None] ** 2) * 4 / (camera.width**2 + camera.height**2)
    return 1.0 - VIGNETTING * r2
