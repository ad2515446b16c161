"""Pictures of a face seen square on, and where a known patch lies in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from preshape.hal.transform import Matrix, axis_rotation, inverse, transform
from preshape.hal.world import CameraModel

Picture = NDArray[np.float32]
PIXELS_PER_M = 1000.0
"""Scale of rectified pictures: 1 mm a pixel."""
_CONTRAST_FLOOR = 6.0
"""Grey levels: patches flatter than this count as this, so that noise matches nothing."""


def smoothed(picture: NDArray[np.floating] | NDArray[np.uint8]) -> Picture:
    """Return the picture blurred by a separable [1 2 1] / 4 kernel, borders repeated."""
    padded = np.pad(picture.astype(np.float32), 1, mode="edge")
    across = (padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:]) / 4
    return ((across[:-2] + 2 * across[1:-1] + across[2:]) / 4).astype(np.float32)


def project(camera: CameraModel, p_world: Matrix) -> Matrix:
    """Return pixel coordinates (n, 2), column then row, of points (n, 3): f x/z + c; not finite behind the camera."""
    X_camera_world = inverse(camera.X_world_camera)
    p = p_world @ X_camera_world[:3, :3].T + X_camera_world[:3, 3]
    depth = np.where(p[:, 2:] > 1e-6, p[:, 2:], np.nan)
    return p[:, :2] / depth * camera.focal_px + np.array([camera.width, camera.height]) / 2


def sample(image: NDArray, pixels: Matrix) -> tuple[Picture, NDArray[np.bool_]]:
    """Return grey levels at pixel coordinates (..., 2) by bilinear interpolation, and which of them were read out.

    Zeros in the image mark what was not read out.
    """
    height, width = image.shape
    x, y = pixels[..., 0] - 0.5, pixels[..., 1] - 0.5
    inside = (x >= 0) & (y >= 0) & (x < width - 1) & (y < height - 1)
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    c, r = x.astype(np.intp), y.astype(np.intp)
    b, a = (x - c).astype(np.float32), (y - r).astype(np.float32)
    flat, at = image.ravel(), r * width + c
    p00, p01, p10, p11 = flat[at], flat[at + 1], flat[at + width], flat[at + width + 1]
    inside &= (p00 > 0) & (p01 > 0) & (p10 > 0) & (p11 > 0)
    grey = (1 - a) * ((1 - b) * p00 + b * p01) + a * ((1 - b) * p10 + b * p11)
    return np.where(inside, grey, 0).astype(np.float32), inside


@dataclass(frozen=True, slots=True, eq=False)
class Rectified:
    """A face seen square on: first row at the largest v, first column at the smallest u, turned by `angle` (rad)."""

    picture: Picture
    seen: NDArray[np.bool_]
    half: Matrix
    angle: float

    def column(self, u: float) -> float:
        """Return the column coordinate of u (m); a pixel's centre is a whole number."""
        return (u + self.half[0]) * PIXELS_PER_M - 0.5

    def row(self, v: float) -> float:
        """Return the row coordinate of v (m)."""
        return (self.half[1] - v) * PIXELS_PER_M - 0.5

    def uv(self, row: float, column: float) -> Matrix:
        """Return the face coordinates (2,) of a picture's place, the turn undone."""
        turned = np.array([(column + 0.5) / PIXELS_PER_M - self.half[0], self.half[1] - (row + 0.5) / PIXELS_PER_M])
        return axis_rotation((0.0, 0.0, 1.0), self.angle)[:2, :2] @ turned


def rectify(image: NDArray, camera: CameraModel, X_world_face: Matrix, half: Matrix, angle: float = 0.0) -> Rectified:
    """Return the picture of a face's rectangle of half edges `half` (2,), m, turned by `angle` about its normal.

    A point (u, v, 0) of the face is seen at K [r1 r2 p] (u, v, 1), X_camera_face = [r1 r2 r3 p].
    """
    X = inverse(camera.X_world_camera) @ X_world_face @ transform(R=axis_rotation((0.0, 0.0, 1.0), angle))
    K = np.array([[camera.focal_px, 0, camera.width / 2], [0, camera.focal_px, camera.height / 2], [0, 0, 1.0]])
    H = K @ X[:3, [0, 1, 3]]
    size = np.rint(2 * np.asarray(half) * PIXELS_PER_M).astype(int)
    u = (np.arange(size[0]) + 0.5) / PIXELS_PER_M - half[0]
    v = half[1] - (np.arange(size[1]) + 0.5) / PIXELS_PER_M
    h = H[:, 0, None, None] * u[None, None, :] + H[:, 1, None, None] * v[None, :, None] + H[:, 2, None, None]
    depth = np.maximum(h[2], 1e-6)
    grey, seen = sample(image, np.stack([h[0] / depth, h[1] / depth], axis=-1))
    return Rectified(grey, seen, np.asarray(half, float), angle)


def resized(patch: NDArray[np.uint8], pixels_per_m: float) -> Picture:
    """Return a patch brought to the rectified scale, each pixel the mean over its area, then blurred like an image."""
    rows, cols = (max(2, round(n * PIXELS_PER_M / pixels_per_m)) for n in patch.shape)
    total = np.pad(np.cumsum(np.cumsum(patch.astype(float), 0), 1), ((1, 0), (1, 0)))
    r, c = np.linspace(0, patch.shape[0], rows + 1), np.linspace(0, patch.shape[1], cols + 1)
    by_row = np.array([np.interp(r, np.arange(patch.shape[0] + 1), column) for column in total.T]).T
    both = np.array([np.interp(c, np.arange(patch.shape[1] + 1), row) for row in by_row])
    area = patch.shape[0] * patch.shape[1] / (rows * cols)
    return smoothed(np.diff(np.diff(both, axis=0), axis=1) / area)


def correlation(picture: Picture, patch: Picture) -> Picture:
    """Return the normalised cross-correlation of a patch at every place where it fits, -1 .. 1.

    sum (I - mean I)(T - mean T) / (|I - mean I| |T - mean T|), by FFT; shape = picture - patch + 1.
    """
    rows, cols = patch.shape
    T = patch - patch.mean()
    shape = picture.shape
    level = float(picture.mean())
    spectrum = np.fft.rfft2(picture - level) * np.conj(np.fft.rfft2(T, shape))
    product = np.fft.irfft2(spectrum, shape)[: shape[0] - rows + 1, : shape[1] - cols + 1]
    total, squares = (_box_sums(x, rows, cols) for x in (picture - level, (picture - level) ** 2))
    n = rows * cols
    energy = np.maximum(squares - total**2 / n, n * _CONTRAST_FLOOR**2)
    return (product / (np.sqrt(energy) * np.linalg.norm(T))).astype(np.float32)


def _box_sums(picture: Picture, rows: int, cols: int) -> Matrix:
    total = np.pad(np.cumsum(np.cumsum(picture.astype(np.float64), 0), 1), ((1, 0), (1, 0)))
    return total[rows:, cols:] - total[:-rows, cols:] - total[rows:, :-cols] + total[:-rows, :-cols]


def trimmed_correlation(picture: Picture, patch: Picture, seen: NDArray[np.bool_], keep: float = 0.8) -> float:
    """Return the correlation of two pictures of one shape over the share of blocks that fit best.

    Gain and level are fitted, the blocks with the largest errors dropped (something may lie in front), fitted again.
    """
    rows, cols = patch.shape
    block = (np.arange(rows) * 4 // rows)[:, None] * 4 + (np.arange(cols) * 4 // cols)[None, :]
    used = seen.copy()
    for _ in range(3):
        if used.sum() < rows * cols // 3:
            return 0.0
        gain, level = np.polyfit(patch[used], picture[used], 1)
        error = np.where(seen, (picture - gain * patch - level) ** 2, 1e6)
        mean_error = np.bincount(block.ravel(), error.ravel(), 16) / np.bincount(block.ravel(), minlength=16)
        used = seen & (mean_error <= np.quantile(mean_error, keep))[block]
    a, b = picture[used] - picture[used].mean(), patch[used] - patch[used].mean()
    floor = _CONTRAST_FLOOR * np.sqrt(used.sum())
    return float(a @ b / (max(float(np.linalg.norm(a)), floor) * max(float(np.linalg.norm(b)), 1e-9)))
