"""The box's visible edges in an image: where each is found, and the pose that fits them together with known points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from preshape.control.rectified import project, sample
from preshape.hal.transform import Matrix, cross, exp_so3, inverse, log_so3
from preshape.hal.world import FACES, CameraModel, Face, face_normal

_STEP_M = 0.003
_CORNER_GAP_M = 0.006
_CONTRAST = 10.0
"""Grey levels over 2 pixels that count as a full edge."""
_MIN_SUPPORT = 0.4
"""Mean contrast, as a share of the full, that a line must reach."""
_HYPOTHESES = 5
_LINE_SIGMA_PX = 2.0
_POINT_SIGMA_PX = 0.8


@dataclass(frozen=True, slots=True)
class PosePrior:
    """How far the estimated pose may be off: standard deviations, m and rad."""

    sigma_m: float = 0.0025
    sigma_rad: float = float(np.deg2rad(2.5))


@dataclass(frozen=True, slots=True, eq=False)
class EdgeLine:
    """One found edge: two points of it in the box's frame, the image normal, shifts seen there (pixels), support."""

    p_box: Matrix
    normal: Matrix
    shift: Matrix
    support: float


@dataclass(frozen=True, slots=True, eq=False)
class SeenPoint:
    """A point known in the box's frame up to a slide along `slide` (zero: none), and the pixel where it is seen."""

    p_box: Matrix
    slide: Matrix
    pixel: Matrix


def visible_faces(
    camera: CameraModel, X_world_box: Matrix, size: Matrix, max_angle: float = np.pi / 2
) -> dict[Face, float]:
    """Return the faces turned to the camera, each with the angle (rad) between its normal and the line of sight."""
    angles: dict[Face, float] = {}
    eye = (inverse(X_world_box) @ camera.X_world_camera)[:3, 3]
    for face in FACES:
        normal = face_normal(face)
        sight = eye - normal * np.asarray(size) / 2
        angle = float(np.arccos(np.clip(normal @ sight / np.linalg.norm(sight), -1.0, 1.0)))
        if angle < max_angle:
            angles[face] = angle
    return angles


@dataclass(frozen=True, slots=True, eq=False)
class _Profile:
    """The contrast (samples, shifts) around one predicted edge: its end points in the box's frame, the image normal."""

    p_box: Matrix
    normal: Matrix
    length_px: float
    s: Matrix
    d: Matrix
    contrast: Matrix


def find_edges(
    image: NDArray, camera: CameraModel, X_world_box: Matrix, size: Matrix, reach_px: float
) -> list[EdgeLine]:
    """Return visible faces' edges that a straight line of contrast within `reach_px` of their prediction supports."""
    lines: list[EdgeLine] = []
    for profile in _profiles(image, camera, X_world_box, size, reach_px):
        score, slopes = _line_scores(profile, min(0.5 * reach_px, 0.12 * profile.length_px))
        # A printed line beside the edge has as much contrast: the nearest to the prediction wins.
        weighted = score - 0.2 * np.abs(profile.d)[None, :] / reach_px
        i, j = np.unravel_index(int(np.argmax(weighted)), score.shape)
        shift = _centroid(score[i], profile.d, int(j)) + slopes[i] * np.array([-1.0, 1.0])
        if score[i, j] >= _MIN_SUPPORT and np.max(np.abs(shift)) <= reach_px:
            lines.append(EdgeLine(profile.p_box, profile.normal, shift, float(score[i, j])))
    return lines


def slides_to_ends(
    image: NDArray, camera: CameraModel, X_world_box: Matrix, size: Matrix, axis: int, reach_m: float, sigma_m: float
) -> list[float]:
    """Return the most likely shifts of the box along its own axis (m), best first, by the edges around its two ends.

    Peaks of sum of the contrast along all end edges - (shift / sigma)^2 / 8: both ends count together, so that a
    line printed beside one end hardly passes for it.
    """
    pixels_per_m = camera.focal_px / max(0.05, float((inverse(camera.X_world_camera) @ X_world_box)[2, 3]))
    shifts = np.arange(-reach_m, reach_m + 1e-9, 0.0004)
    total = -((shifts / sigma_m) ** 2) / 8.0
    step = np.eye(3)[axis] * 1e-4
    for profile in _profiles(image, camera, X_world_box, size, reach_m * pixels_per_m * 1.15):
        if abs(profile.p_box[1, axis] - profile.p_box[0, axis]) > 1e-9:
            continue
        score, _ = _line_scores(profile, 3.0)
        middle = profile.p_box.mean(axis=0)
        moved_px = _pixels(camera, X_world_box, np.array([middle, middle + step]))
        rate = float(profile.normal @ (moved_px[1] - moved_px[0])) / 1e-4
        total += np.interp(rate * shifts, profile.d, score.max(axis=0), left=0.0, right=0.0)
    peaks: list[float] = []
    for at in np.argsort(-total):
        if all(abs(shifts[at] - peak) > 0.002 for peak in peaks):
            peaks.append(float(shifts[at]))
        if len(peaks) == _HYPOTHESES:
            break
    return peaks


def likelihood(
    image: NDArray, camera: CameraModel, X_world_box: Matrix, X_world_prior: Matrix, size: Matrix, prior: PosePrior
) -> float:
    """Return how well a pose fits the image: contrast along its visible edges, less its distance from the prior."""
    support = 0.0
    for profile in _profiles(image, camera, X_world_box, size, 1.0):
        support += float(_line_scores(profile, 0.5)[0].max())
    shift = (X_world_box[:3, 3] - X_world_prior[:3, 3]) / prior.sigma_m
    turn = log_so3(X_world_box[:3, :3] @ X_world_prior[:3, :3].T) / prior.sigma_rad
    return support - 0.05 * float(shift @ shift + turn @ turn)


def _profiles(
    image: NDArray, camera: CameraModel, X_world_box: Matrix, size: Matrix, reach_px: float
) -> Iterator[_Profile]:
    visible = visible_faces(camera, X_world_box, size, np.deg2rad(85.0))
    for a, b in combinations(FACES, 2):
        if a[1] != b[1] and (a in visible or b in visible):
            profile = _profile(image, camera, X_world_box, np.asarray(size), (face_normal(a), face_normal(b)), reach_px)
            if profile is not None:
                yield profile


def _profile(
    image: NDArray,
    camera: CameraModel,
    X_world_box: Matrix,
    size: Matrix,
    normals: tuple[Matrix, Matrix],
    reach_px: float,
) -> _Profile | None:
    middle = (normals[0] + normals[1]) * size / 2
    along = cross(*normals)
    half = float(np.abs(along) @ size) / 2 - _CORNER_GAP_M
    s = np.linspace(-1.0, 1.0, max(8, int(2 * half / _STEP_M)))
    pixels = _pixels(camera, X_world_box, middle + np.outer(s * half, along))
    if not np.all(np.isfinite(pixels)):
        return None
    direction = pixels[-1] - pixels[0]
    length = float(np.linalg.norm(direction))
    if length < 20.0:
        return None
    normal = np.array([-direction[1], direction[0]]) / length
    contrast, d = _contrast(image, pixels, normal, reach_px)
    return (
        None if contrast is None else _Profile(middle + np.outer([-half, half], along), normal, length, s, d, contrast)
    )


def _contrast(image: NDArray, pixels: Matrix, normal: Matrix, reach_px: float) -> tuple[Matrix | None, Matrix]:
    """Return the contrast (samples, shifts), 0 .. 1, across an edge, and the shifts (pixels); None if mostly unread."""
    d: Matrix = np.arange(-reach_px - 1.0, reach_px + 1.01, 0.5, dtype=np.float64)
    grey, seen = sample(image, pixels[:, None, :] + d[None, :, None] * normal)
    read = np.all(seen, axis=1)
    if np.mean(read) < 0.4:
        return None, d
    difference = np.abs(grey[:, 4:] - grey[:, :-4])[read]
    contrast = np.zeros((len(pixels), len(d) - 4))
    contrast[read] = np.minimum(difference / _CONTRAST, 1.0)
    return contrast, d[2:-2]


def _line_scores(profile: _Profile, max_slope: float) -> tuple[Matrix, Matrix]:
    """Return the mean contrast along straight lines (slopes, shifts), and the slopes: pixels from middle to end."""
    d = profile.d
    slopes: Matrix = np.arange(-np.floor(2 * max_slope) / 2, max_slope + 0.01, 0.5, dtype=np.float64)
    steps = np.rint(np.outer(slopes, profile.s) / 0.5).astype(int)
    padded = np.pad(profile.contrast, ((0, 0), (len(d), len(d))))
    at = np.arange(len(d))[None, :, None] + len(d) + steps[:, None, :]
    return padded[np.arange(len(profile.s)), at].mean(axis=2), slopes


def _centroid(score: Matrix, d: Matrix, at: int) -> float:
    near = slice(max(0, at - 3), at + 4)
    weight = np.maximum(score[near] - 0.7 * score[at], 0.0)
    return float(weight @ d[near] / weight.sum()) if weight.sum() > 0 else float(d[at])


def _pixels(camera: CameraModel, X_world_box: Matrix, p_box: Matrix) -> Matrix:
    return project(camera, p_box @ X_world_box[:3, :3].T + X_world_box[:3, 3])


def moved(X_world_box: Matrix, change: Matrix) -> Matrix:
    """Return the pose shifted by change[:3] (m, world) and turned about its origin by change[3:6] (rad, world)."""
    X = X_world_box.copy()
    X[:3, :3] = exp_so3(change[3:6]) @ X[:3, :3]
    X[:3, 3] += change[:3]
    return X


def fit_pose(
    camera: CameraModel,
    X_world_prior: Matrix,
    X_world_box: Matrix,
    lines: Sequence[EdgeLine],
    points: Sequence[SeenPoint],
    prior: PosePrior,
) -> tuple[Matrix, float]:
    """Return the pose, and the slide of the points (m), that fit edges, points and prior best.

    Minimises sum rho(n . (pi(X p) - pi(X_0 p)) - shift) + |pi(X (p + s slide)) - pixel|^2 + |X - X_prior|^2 over the
    pose and s by Gauss-Newton, each term over its standard deviation; rho is Cauchy's, so a wrong line lets go.
    `X_world_box` is the pose X_0 at which the edges were looked for.
    """
    line_points = np.array([p for line in lines for p in line.p_box]).reshape(-1, 3)
    normals = np.repeat(np.array([line.normal for line in lines]).reshape(-1, 2), 2, axis=0)
    wanted = np.array([line.shift for line in lines]).ravel()
    reference = _pixels(camera, X_world_box, line_points) if len(lines) else np.zeros((0, 2))
    fixed = np.array([point.p_box for point in points]).reshape(-1, 3)
    slides = np.array([point.slide for point in points]).reshape(-1, 3)
    pixels = np.array([point.pixel for point in points]).reshape(-1, 2)
    prior_sigma = np.repeat([prior.sigma_m, prior.sigma_rad], 3)

    def residual(change: Matrix) -> tuple[Matrix, Matrix]:
        X = moved(X_world_prior, change)
        edges = np.zeros(0)
        if len(lines):
            edges = (np.sum(normals * (_pixels(camera, X, line_points) - reference), axis=1) - wanted) / _LINE_SIGMA_PX
        seen = np.zeros(0)
        if len(points):
            seen = ((_pixels(camera, X, fixed + change[6] * slides) - pixels) / _POINT_SIGMA_PX).ravel()
        return edges, np.concatenate([seen, change[:6] / prior_sigma, change[6:] / 0.1])

    change = np.zeros(7)
    for _ in range(8):
        edges, rest = residual(change)
        weight = 1.0 / np.sqrt(1.0 + (edges / 2.0) ** 2)
        r0 = np.concatenate([weight * edges, rest])
        J = np.empty((len(r0), 7))
        for k in range(7):
            step = np.zeros(7)
            step[k] = 1e-6
            edges_k, rest_k = residual(change + step)
            J[:, k] = (np.concatenate([weight * edges_k, rest_k]) - r0) / 1e-6
        update = np.linalg.lstsq(J, -r0, rcond=None)[0]
        change += update
        if float(np.max(np.abs(update))) < 1e-6:
            break
    return moved(X_world_prior, change), float(change[6])
