"""Finds the opening area in one image: image work on the known print, never a look at where it truly is.

Each candidate face turned to the camera is rectified from the estimated pose; the print is searched along both long
edges by normalised correlation; then pose and offset are fitted together to the print, the box's visible edges and the
estimate, so that the offset is measured from the box's own ends and an error of the estimate cancels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from preshape.control.box_edges import (
    EdgeLine,
    PosePrior,
    SeenPoint,
    find_edges,
    fit_pose,
    likelihood,
    slides_to_ends,
    visible_faces,
)
from preshape.control.rectified import (
    Picture,
    Rectified,
    correlation,
    project,
    rectify,
    resized,
    smoothed,
    trimmed_correlation,
)
from preshape.hal.box_face import FaceFrame, face_frame
from preshape.hal.transform import Matrix
from preshape.hal.world import FACES, CameraModel, Face, Image, NominalBox, Opening, TextureLibrary

MAX_VIEW_ANGLE = np.deg2rad(55.0)
"""Faces seen more obliquely are not searched where the opening is to be measured."""
GLANCE_VIEW_ANGLE = np.deg2rad(80.0)
"""The same where it is only to be told which face carries it."""
ACCEPT, REJECT = 0.70, 0.55
"""Scores from which a match is the opening, and below which it is none."""
DISTINCT = 0.08
"""How far the best score must lie above that of any other place."""
_MARGIN_M = 0.020
_ACROSS_M = 0.014
"""How far across the face the print may appear from where the estimated pose puts it, m."""
_TURNS = np.deg2rad([-9.0, -6.0, -3.0, 0.0, 3.0, 6.0, 9.0])
_WORTH_FITTING = 0.40
_MIN_SEEN = 0.6


class Verdict(StrEnum):
    """What one image says about the opening."""

    FOUND = "found"
    NOT_HERE = "not on the faces seen"
    AMBIGUOUS = "ambiguous"
    NOT_SEEN = "no candidate face in view"


@dataclass(frozen=True, slots=True, eq=False)
class OpeningMatch:
    """The best place for the opening along one long edge of one face.

    `offset` (m) is from the box's middle along its long axis; `score` the correlation with the known print (-1 .. 1);
    `X_world_box` the box's pose refitted to the image, `edges` how many of its edges that rests on; `view_angle` rad.
    """

    face: Face
    edge: Face
    offset: float
    score: float
    X_world_box: Matrix
    edges: int
    view_angle: float

    @property
    def opening(self) -> Opening:
        """The match as the planner takes it."""
        return Opening(self.face, self.edge, self.offset)


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """The verdict, the match it rests on (the best one, also when it is not accepted) and the faces it speaks of."""

    verdict: Verdict
    match: OpeningMatch | None
    faces: tuple[Face, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """The patch's centre in face coordinates (2,), m, its turn (rad) and correlation."""

    uv: Matrix
    angle: float
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """One image with what every search in it needs."""

    pixels: Picture
    camera: CameraModel
    size: Matrix
    X_world_prior: Matrix
    prior: PosePrior


def find_opening(
    image: Image,
    X_world_box: Matrix,
    nominal: NominalBox,
    library: TextureLibrary,
    prior: PosePrior | None = None,
    max_view_angle: float = MAX_VIEW_ANGLE,
) -> list[OpeningMatch]:
    """Return the best match for each long edge of each candidate face in view, best first.

    `X_world_box` is the box's estimated pose when the image was taken; faces seen more obliquely than
    `max_view_angle` (rad) are left out. Empty when no candidate face is in view.
    """
    prior = prior or PosePrior()
    pixels = np.where(image.pixels > 0, smoothed(image.pixels), 0.0).astype(np.float32)
    view = _View(pixels, image.model, np.asarray(nominal.size, float), X_world_box, prior)
    patch = resized(library.opening, library.pixels_per_m)
    angles = visible_faces(image.model, X_world_box, view.size, max_view_angle)
    matches = [
        match
        for face in nominal.candidate_faces
        if face in angles
        for match in _search_face(view, face, angles[face], patch, library.extent_m)
    ]
    return sorted(matches, key=lambda match: -match.score)


def decide(matches: Sequence[OpeningMatch]) -> Decision:
    """Return what the matches of one image mean: found, not on these faces, ambiguous, or no face seen."""
    faces: tuple[Face, ...] = tuple(face for face in FACES if any(match.face == face for match in matches))
    if not matches:
        return Decision(Verdict.NOT_SEEN, None, faces)
    ranked = sorted(matches, key=lambda match: -match.score)
    best = ranked[0]
    second = ranked[1].score if len(ranked) > 1 else -1.0
    if best.score < REJECT:
        return Decision(Verdict.NOT_HERE, best, faces)
    if best.score < ACCEPT or best.score - second < DISTINCT:
        return Decision(Verdict.AMBIGUOUS, best, faces)
    return Decision(Verdict.FOUND, best, faces)


def _search_face(
    view: _View, face: Face, angle: float, patch: Picture, extent: tuple[float, float]
) -> list[OpeningMatch]:
    frame = face_frame(view.size, face)
    X_world_face = view.X_world_prior @ frame.X_box_face
    turned = [rectify(view.pixels, view.camera, X_world_face, frame.half + _MARGIN_M, float(turn)) for turn in _TURNS]
    face_seen = np.mean([np.mean(picture.seen) for picture in turned])
    if face_seen < _MIN_SEEN:
        return []
    edges: list[Face] = [edge for edge in FACES if frame.edge_sign(edge) != 0]
    return [_search_edge(view, frame, face, edge, angle, turned, patch, extent) for edge in edges]


def _search_edge(
    view: _View,
    frame: FaceFrame,
    face: Face,
    edge: Face,
    angle: float,
    turned: Sequence[Rectified],
    patch: Picture,
    extent: tuple[float, float],
) -> OpeningMatch:
    """Return the best match at one edge: the coarse place, then pose and offset fitted in turns."""
    sign = frame.edge_sign(edge)
    upright = np.ascontiguousarray(patch[::-1, ::-1]) if sign > 0 else patch
    v_edge = sign * (frame.half[1] - extent[1] / 2)
    X = view.X_world_prior
    place = _best_place(turned, upright, frame, v_edge, extent, _ACROSS_M)
    if place.score < _WORTH_FITTING:
        return OpeningMatch(face, edge, float(place.uv[0]), place.score, X, 0, angle)
    X, edges = _fit(view, frame, X, place, v_edge, extent)
    near = [
        rectify(view.pixels, view.camera, X @ frame.X_box_face, frame.half + _MARGIN_M, float(turn))
        for turn in np.deg2rad([-1.5, 0.0, 1.5])
    ]
    place = _best_place(near, upright, frame, v_edge, extent, 0.006)
    score = _score(near, place, upright)
    return OpeningMatch(face, edge, float(place.uv[0]), score, X, edges, angle)


def _fit(
    view: _View, frame: FaceFrame, X_world_box: Matrix, place: _Place, v_edge: float, extent: tuple[float, float]
) -> tuple[Matrix, int]:
    """Return the pose that fits the print's place and the box's edges best, and how many edges were found.

    The place of the print fixes everything but the slide along the edge; the box's two ends fix that, and as lines
    may be printed beside the ends, every likely slide is fitted and the likeliest pose kept.
    """
    camera, size, prior = view.camera, view.size, view.prior
    points = _seen_points(camera, X_world_box, frame, place, v_edge, extent)
    X_seen, _ = fit_pose(camera, view.X_world_prior, X_world_box, [], points, prior)
    axis = int(np.argmax(np.abs(frame.X_box_face[:3, 0])))
    best, best_edges, best_value = X_seen, 0, -np.inf
    for slide in slides_to_ends(view.pixels, camera, X_seen, size, axis, 0.014, 2 * prior.sigma_m):
        X = X_seen.copy()
        X[:3, 3] += X[:3, axis] * slide
        lines: list[EdgeLine] = []
        for reach_px in (5.0, 3.0):
            lines = find_edges(view.pixels, camera, X, size, reach_px)
            X, _ = fit_pose(camera, view.X_world_prior, X, lines, points, prior)
        value = likelihood(view.pixels, camera, X, view.X_world_prior, size, prior)
        if value > best_value:
            best, best_edges, best_value = X, len(lines), value
    return best, best_edges


def _best_place(
    pictures: Sequence[Rectified],
    patch: Picture,
    frame: FaceFrame,
    v_edge: float,
    extent: tuple[float, float],
    across: float,
) -> _Place:
    """Return the place of highest correlation over the turns with the tab within `across` (m) of the edge."""
    best = _Place(np.array([0.0, v_edge]), 0.0, -1.0)
    reach = frame.half[0] - extent[0] / 2
    for rectified in pictures:
        scores = correlation(_filled(rectified), patch)
        half_rows, half_cols = (patch.shape[0] - 1) / 2, (patch.shape[1] - 1) / 2
        top, bottom = rectified.row(v_edge + across) - half_rows, rectified.row(v_edge - across) - half_rows
        left, right = rectified.column(-reach) - half_cols, rectified.column(reach) - half_cols
        r0, r1 = int(max(0, np.floor(top))), int(min(scores.shape[0], np.ceil(bottom) + 1))
        c0, c1 = int(max(0, np.floor(left))), int(min(scores.shape[1], np.ceil(right) + 1))
        if r1 <= r0 or c1 <= c0:
            continue
        r, c = np.unravel_index(int(np.argmax(scores[r0:r1, c0:c1])), (r1 - r0, c1 - c0))
        row, col = int(r) + r0, int(c) + c0
        if scores[row, col] > best.score:
            dr, dc = _peak(scores[:, col], row), _peak(scores[row], col)
            best = _Place(
                rectified.uv(row + dr + half_rows, col + dc + half_cols), rectified.angle, float(scores[row, col])
            )
    return best


def _filled(rectified: Rectified) -> Picture:
    """Return the picture with what was not read out set to the mean of the rest."""
    if np.all(rectified.seen):
        return rectified.picture
    level = float(rectified.picture[rectified.seen].mean()) if np.any(rectified.seen) else 0.0
    return np.where(rectified.seen, rectified.picture, level).astype(np.float32)


def _peak(values: Picture, at: int) -> float:
    """Return how far a parabola's top lies from the largest of three neighbours, -0.5 .. 0.5."""
    if at == 0 or at == len(values) - 1:
        return 0.0
    left, middle, right = (float(values[at + k]) for k in (-1, 0, 1))
    bend = left - 2 * middle + right
    return 0.0 if bend >= -1e-12 else float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5))


def _seen_points(
    camera: CameraModel,
    X_world_box: Matrix,
    frame: FaceFrame,
    place: _Place,
    v_edge: float,
    extent: tuple[float, float],
) -> list[SeenPoint]:
    """Return the print's corners: in the box's frame at offset zero, free to slide along u, and where they are seen."""
    c, s = np.cos(place.angle), np.sin(place.angle)
    points: list[SeenPoint] = []
    for du, dv in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)):
        corner = np.array([du * extent[0], dv * extent[1]])
        seen = place.uv + np.array([c * corner[0] - s * corner[1], s * corner[0] + c * corner[1]])
        p_seen = X_world_box @ frame.X_box_face @ np.array([*seen, 0.0, 1.0])
        p_box = frame.X_box_face @ np.array([corner[0], v_edge + corner[1], 0.0, 1.0])
        points.append(SeenPoint(p_box[:3], frame.X_box_face[:3, 0], project(camera, p_seen[None, :3])[0]))
    return points


def _score(pictures: Sequence[Rectified], place: _Place, patch: Picture) -> float:
    """Return the trimmed correlation at a place, in the picture that has its turn."""
    rectified = next(picture for picture in pictures if picture.angle == place.angle)
    c, s = np.cos(place.angle), np.sin(place.angle)
    u, v = c * place.uv[0] + s * place.uv[1], -s * place.uv[0] + c * place.uv[1]
    row = int(np.rint(rectified.row(v) - (patch.shape[0] - 1) / 2))
    col = int(np.rint(rectified.column(u) - (patch.shape[1] - 1) / 2))
    row = int(np.clip(row, 0, rectified.picture.shape[0] - patch.shape[0]))
    col = int(np.clip(col, 0, rectified.picture.shape[1] - patch.shape[1]))
    window = np.s_[row : row + patch.shape[0], col : col + patch.shape[1]]
    return trimmed_correlation(rectified.picture[window], patch, rectified.seen[window])
