"""A software renderer: boxes, capsules, cylinders and ellipsoids in, an RGB image out, the same on every machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image as PillowImage

from preshape.hal.transform import Matrix, cross, inverse, transform
from preshape.tools import raster_kernels as kernels
from preshape.tools.shape import Kind, Shape

Picture = NDArray[np.uint8]
_KIND_NUMBER: dict[Kind, int] = {
    "box": kernels.BOX, "capsule": kernels.CAPSULE, "cylinder": kernels.CYLINDER, "ellipsoid": kernels.ELLIPSOID,
    "convex": kernels.CONVEX,
}  # fmt: skip
BACKGROUND = np.array([[0.93, 0.95, 0.98], [0.80, 0.82, 0.86]])
"""Colours of the picture's top and bottom where nothing is."""
LIGHT = np.array([0.30, -0.45, 0.84]) / np.linalg.norm([0.30, -0.45, 0.84])
"""Direction towards the lamp, world frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Where a picture is taken from: pose (z forward, x right, y down) and the opening angle over its height, rad."""

    X_world_camera: Matrix
    height_angle: float = 0.7


def look_at(eye: ArrayLike, target: ArrayLike, height_angle: float = 0.7) -> Camera:
    """Return a camera at `eye` that looks at `target` (world, m), its rows level unless it looks straight down."""
    forward = np.asarray(target, float) - np.asarray(eye, float)
    distance = float(np.linalg.norm(forward))
    if distance < 1e-9:
        raise ValueError("a camera needs a target apart from its eye")
    forward /= distance
    up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    right = cross(forward, up)
    right /= np.linalg.norm(right)
    return Camera(transform(eye, np.column_stack([right, cross(forward, right), forward])), height_angle)


def focal_length(camera: Camera, height: int) -> float:
    """Return the focal length in pixels of a picture of this height."""
    return height / 2 / float(np.tan(camera.height_angle / 2))


def project(points: ArrayLike, camera: Camera, width: int, height: int) -> Matrix:
    """Return (n, 3): column and row in pixels and depth (m) of world points (n, 3); behind the camera depth <= 0."""
    X = inverse(camera.X_world_camera)
    p = np.atleast_2d(np.asarray(points, float)) @ X[:3, :3].T + X[:3, 3]
    scale = focal_length(camera, height) / np.where(p[:, 2] > 1e-9, p[:, 2], np.nan)
    return np.column_stack([width / 2 + p[:, 0] * scale, height / 2 + p[:, 1] * scale, p[:, 2]])


def pixel_window(
    half: Matrix, X_camera_shape: Matrix, focal: float, width: int, height: int
) -> tuple[int, int, int, int]:
    """Return first and last (exclusive) column and row that a bounding box can cover.

    That is the whole picture if the box reaches behind the camera, and nothing if all of it is there.
    """
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    corners = (signs * half) @ X_camera_shape[:3, :3].T + X_camera_shape[:3, 3]
    if np.all(corners[:, 2] < kernels.NEAR):
        return 0, 0, 0, 0
    if np.any(corners[:, 2] < kernels.NEAR):
        return 0, width, 0, height
    pixels = corners[:, :2] / corners[:, 2:] * focal + np.array([width / 2, height / 2])
    low, high = np.floor(pixels.min(0)), np.ceil(pixels.max(0))
    limits = (width, height)
    first = [int(np.clip(low[k], 0, limits[k])) for k in range(2)]
    last = [int(np.clip(high[k], 0, limits[k])) for k in range(2)]
    return first[0], last[0], first[1], last[1]


def render(shapes: Sequence[Shape], camera: Camera, width: int = 640, height: int = 480, samples: int = 2) -> Picture:
    """Return the picture (height, width, 3) of the shapes, each pixel the mean of samples x samples rays.

    A shape that encloses the camera is not drawn.
    """
    if width < 1 or height < 1 or samples < 1:
        raise ValueError(f"a picture needs width, height and samples >= 1, got {width}, {height}, {samples}")
    rows, columns = height * samples, width * samples
    depth = np.full((rows, columns), np.inf, np.float32)
    facet = np.full((rows, columns), -1, np.int32)
    shade = np.ones((rows, columns), np.float32)
    flat = np.array([shape.flat for shape in shapes], dtype=bool)
    colors = np.array([shape.color for shape in shapes], dtype=float).reshape(-1, 3)
    if shapes:
        focal = focal_length(camera, rows)
        X_camera_world = inverse(camera.X_world_camera)
        X = X_camera_world @ np.array([shape.X_world_shape for shape in shapes])
        windows = [pixel_window(shape.half(), X[i], focal, columns, rows) for i, shape in enumerate(shapes)]
        kinds = np.array([_KIND_NUMBER[shape.kind] for shape in shapes])
        sizes = np.array([shape.size for shape in shapes], float)
        planes = np.vstack([shape.planes for shape in shapes])
        first_plane = np.cumsum([0, *(len(shape.planes) for shape in shapes)])
        light = X_camera_world[:3, :3] @ LIGHT
        kernels.cast(kinds, X, sizes, planes, first_plane, np.array(windows), light, focal, depth, facet, shade)
        shade[(facet >= 0) & np.append(flat, False)[facet // kernels.FACETS]] = 1.0
        kernels.draw_edges(depth, facet, ~flat, shade)
    image = np.empty((height, width, 3), np.uint8)
    kernels.resolve(facet, shade, colors, BACKGROUND, samples, image)
    return image


def save_png(picture: Picture, path: Path | str) -> Path:
    """Write a picture (h, w, 3) as PNG and return its path; folders are made."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    PillowImage.fromarray(picture).save(path, format="PNG")
    return path
