"""The finder on rendered images: a box, a table and a finger in front, cast by the simulator's camera."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import ArrayLike

from preshape.control.box_edges import PosePrior
from preshape.control.opening_finder import ACCEPT, REJECT, OpeningMatch, Verdict, decide, find_opening
from preshape.hal.box_face import face_frame
from preshape.hal.transform import Matrix, axis_rotation, exp_so3, log_so3, transform
from preshape.hal.world import CameraModel, Face, Image, NominalBox, Opening, opposite
from preshape.sim_backend.camera import SceneCamera, box_surface, pixel_rays, whole, window_around
from preshape.sim_backend.scenario import DrawSection, OpeningSection, Scenario
from preshape.sim_backend.texture import face_textures, texture_library

SIZE = np.array([0.06, 0.09, 0.20])
NOMINAL = NominalBox(SIZE, ("+x", "-x"))
LIBRARY = texture_library(0.045, 0.040)
SEEDS = 120


def unit(v: ArrayLike) -> Matrix:
    values = np.asarray(v, np.float64)
    return values / float(np.sqrt(values @ values))


def camera_at(position: Matrix, target: Matrix) -> CameraModel:
    forward = unit(target - position)
    right = unit(np.cross(forward, [0.0, 0.0, 1.0]))
    return CameraModel(
        transform(position, np.column_stack([right, np.cross(forward, right), forward])), 800.0, 1280, 720
    )


CAMERA = camera_at(np.array([0.05, 0.0, 0.75]), np.array([0.52, -0.15, 0.22]))


class Studio:
    """A box, a table and a finger-like bar, posed at will."""

    def __init__(self) -> None:
        spec = mujoco.MjSpec()
        shape = mujoco.mjtGeom.mjGEOM_BOX
        spec.worldbody.add_geom(type=shape, size=[0.4, 0.6, 0.025], pos=[0.55, 0, -0.025], rgba=[0.75, 0.75, 0.78, 1])
        box = spec.worldbody.add_body(name="box", mocap=True)
        box.add_geom(name="box", type=shape, size=SIZE / 2)
        finger = spec.worldbody.add_body(name="finger", mocap=True)
        finger.add_geom(name="finger", type=shape, size=[0.04, 0.0125, 0.0125], rgba=[0.35, 0.35, 0.37, 1])
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.finger = self.model.geom("finger").id

    def put(self, X_world_box: Matrix, X_world_finger: Matrix) -> None:
        for index, X in enumerate((X_world_box, X_world_finger)):
            self.data.mocap_pos[index] = X[:3, 3]
            mujoco.mju_mat2Quat(self.data.mocap_quat[index], np.ascontiguousarray(X[:3, :3]).ravel())
        mujoco.mj_forward(self.model, self.data)

    def hidden_share(self, X_world_face: Matrix, half: Matrix) -> float:
        """Share of a rectangle of a face that the finger hides from the camera."""
        u, v = np.meshgrid(np.linspace(-1, 1, 21) * half[0], np.linspace(-1, 1, 21) * half[1])
        points = np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], 1) @ X_world_face[:3, :3].T + X_world_face[:3, 3]
        eye = CAMERA.X_world_camera[:3, 3]
        geom, distance = np.empty(len(points), np.int32), np.empty(len(points))
        rays = (points - eye).ravel()
        mujoco.mj_multiRay(self.model, self.data, eye, rays, None, True, -1, geom, distance, None, len(points), 10.0)
        return float(np.mean(geom == self.finger))


STUDIO = Studio()


class Shot:
    """One drawn scene with its image and a wrong pose estimate, 2 mm and 2 deg of noise and of bias."""

    def __init__(self, seed: int, show_opening: bool = True, noise: float = 1.0, finger: bool = True) -> None:
        rng = np.random.default_rng((41, seed))
        draw = DrawSection(offset_m=0.010, faces=("+x", "-x"), edges=True)
        self.scenario = Scenario(name="studio", draw=draw).drawn(seed)
        opening = self.scenario.opening
        self.face: Face = opening.face if show_opening else opposite(opening.face)
        self.X_world_box, X_world_face = self._pose(rng)
        frame = face_frame(SIZE, self.face)
        X_world_finger = transform((0.0, 0.0, -5.0))
        while finger:
            end, across, reach = rng.choice([-1, 1]), rng.uniform(-0.045, 0.045), rng.uniform(0.02, 0.07)
            X_face_finger = transform(
                (end * (0.14 - reach), across, 0.0135), axis_rotation((0.0, 0.0, 1.0), rng.uniform(-0.4, 0.4))
            )
            X_world_finger = X_world_face @ X_face_finger
            STUDIO.put(self.X_world_box, X_world_finger)
            if STUDIO.hidden_share(X_world_face, frame.half) <= 0.15:
                break
        STUDIO.put(self.X_world_box, X_world_finger)
        shift = 0.002 * (noise * rng.standard_normal(3) + unit(rng.standard_normal(3)))
        turn = np.deg2rad(2.0) * (noise * rng.standard_normal(3) + unit(rng.standard_normal(3)))
        self.X_world_estimate = transform(self.X_world_box[:3, 3] + shift, exp_so3(turn) @ self.X_world_box[:3, :3])
        camera = SceneCamera(STUDIO.model, box_surface(STUDIO.model, SIZE), face_textures(self.scenario), seed)
        window = window_around(CAMERA, self.X_world_estimate, SIZE)
        self.image = Image(0, camera.cast(STUDIO.data, CAMERA, window), CAMERA)

    def _pose(self, rng: np.random.Generator) -> tuple[Matrix, Matrix]:
        """Draw a pose whose face is up to 25 deg off the line of sight, 0.50 to 0.65 m away, at any roll."""
        R_world_camera, eye = CAMERA.X_world_camera[:3, :3], CAMERA.X_world_camera[:3, 3]
        centre = eye + R_world_camera @ [rng.uniform(-0.08, 0.08), rng.uniform(-0.05, 0.05), rng.uniform(0.50, 0.65)]
        sight = unit(eye - centre)
        off = np.deg2rad(rng.uniform(0.0, 25.0))
        normal = axis_rotation(unit(np.cross(sight, rng.standard_normal(3))), off) @ sight
        u = unit(np.cross(normal, rng.standard_normal(3)))
        frame = face_frame(SIZE, self.face)
        X_world_face = transform(centre, np.column_stack([u, np.cross(normal, u), normal]))
        R_world_box = X_world_face[:3, :3] @ frame.X_box_face[:3, :3].T
        return transform(centre - R_world_box @ frame.X_box_face[:3, 3], R_world_box), X_world_face

    def is_right(self, match: OpeningMatch | None, tolerance: float = 0.010) -> bool:
        truth = self.scenario.opening
        return (
            match is not None
            and (match.face, match.edge) == (truth.face, truth.edge)
            and abs(match.offset - truth.offset_m) <= tolerance
        )


@pytest.mark.slow
def test_finds_the_opening_within_10_mm_in_99_of_100_images() -> None:
    right, offsets = 0, []
    for seed in range(SEEDS):
        shot = Shot(seed)
        decision = decide(find_opening(shot.image, shot.X_world_estimate, NOMINAL, LIBRARY))
        right += decision.verdict is Verdict.FOUND and shot.is_right(decision.match)
        assert decision.match is not None
        offsets.append(abs(decision.match.offset - shot.scenario.opening.offset_m))
    assert right >= 0.99 * SEEDS
    assert np.median(offsets) < 0.002


@pytest.mark.slow
def test_a_face_with_decoys_only_is_never_taken_for_the_opening() -> None:
    for seed in range(SEEDS // 2):
        shot = Shot(seed, show_opening=False)
        decision = decide(find_opening(shot.image, shot.X_world_estimate, NOMINAL, LIBRARY))
        assert decision.verdict is Verdict.NOT_HERE, seed
        assert decision.faces == (shot.face,)


@pytest.mark.slow
def test_refitted_pose_is_better_than_a_filtered_estimate() -> None:
    before, after = [], []
    for seed in range(40):
        shot = Shot(seed, noise=0.15)
        prior = PosePrior(0.0015, np.deg2rad(1.5))
        match = find_opening(shot.image, shot.X_world_estimate, NOMINAL, LIBRARY, prior)[0]
        for X, errors in ((shot.X_world_estimate, before), (match.X_world_box, after)):
            turn = log_so3(X[:3, :3] @ shot.X_world_box[:3, :3].T)
            errors.append((np.linalg.norm(X[:3, 3] - shot.X_world_box[:3, 3]), np.linalg.norm(turn)))
    assert np.all(np.median(after, axis=0) < 0.9 * np.median(before, axis=0))
    assert np.max(np.array(after)[:, 1]) < np.deg2rad(5.0)


def test_finds_the_opening_on_a_few_images() -> None:
    for seed in range(3):
        shot = Shot(seed)
        decision = decide(find_opening(shot.image, shot.X_world_estimate, NOMINAL, LIBRARY))
        assert decision.verdict is Verdict.FOUND and shot.is_right(decision.match)


def test_same_image_gives_same_matches() -> None:
    shot = Shot(5)
    a, b = (find_opening(shot.image, shot.X_world_estimate, NOMINAL, LIBRARY) for _ in range(2))
    assert [(m.offset, m.score) for m in a] == [(m.offset, m.score) for m in b]


def test_box_turned_away_or_out_of_the_window_is_not_seen() -> None:
    shot = Shot(1)
    edge_on = shot.X_world_box @ transform(R=axis_rotation((0.0, 0.0, 1.0), np.pi / 2))
    assert decide(find_opening(shot.image, edge_on, NOMINAL, LIBRARY)).verdict is Verdict.NOT_SEEN
    blank = Image(0, np.zeros_like(shot.image.pixels), CAMERA)
    assert decide(find_opening(blank, shot.X_world_estimate, NOMINAL, LIBRARY)).verdict is Verdict.NOT_SEEN


def test_verdict_needs_a_high_score_and_no_rival() -> None:
    def match(score: float, face: Face = "+x") -> OpeningMatch:
        return OpeningMatch(face, "+y", 0.0, score, np.eye(4), 4, 0.1)

    assert decide([match(ACCEPT + 0.1), match(0.3)]).verdict is Verdict.FOUND
    assert decide([match(ACCEPT + 0.1), match(ACCEPT + 0.08, "-x")]).verdict is Verdict.AMBIGUOUS
    assert decide([match((ACCEPT + REJECT) / 2), match(0.2)]).verdict is Verdict.AMBIGUOUS
    assert decide([match(REJECT - 0.1), match(0.2)]).verdict is Verdict.NOT_HERE
    assert decide([]).verdict is Verdict.NOT_SEEN
    assert match(0.9).opening == Opening("+x", "+y", 0.0)


def test_textures_are_the_seed_s_and_the_opening_lies_where_the_scenario_says() -> None:
    scenario = Scenario(name="print", opening=OpeningSection(offset_m=0.008)).drawn(3)
    textures = face_textures(scenario)
    assert all(np.array_equal(texture, face_textures(scenario)[face]) for face, texture in textures.items())
    other = face_textures(scenario.drawn(4))
    assert not any(np.array_equal(texture, other[face]) for face, texture in textures.items())
    sign = face_frame(SIZE, "+x").edge_sign("+y")
    rows, cols = LIBRARY.opening.shape
    middle = 200 + 16
    columns = slice(middle - cols // 2, middle - cols // 2 + cols)
    area = textures["+x"][:rows, columns][::-1, ::-1] if sign > 0 else textures["+x"][-rows:, columns]
    assert np.corrcoef(area.ravel(), LIBRARY.opening.ravel())[0, 1] > 0.99
    assert np.corrcoef(textures["-x"][-rows:, columns].ravel(), LIBRARY.opening.ravel())[0, 1] < 0.6


def test_window_shows_the_same_scene_as_the_whole_image() -> None:
    shot = Shot(2)
    camera = SceneCamera(STUDIO.model, box_surface(STUDIO.model, SIZE), face_textures(shot.scenario), 0)
    small = CameraModel(CAMERA.X_world_camera, 200.0, 320, 180)
    window = window_around(small, shot.X_world_box, SIZE)
    part, all_of_it = camera.cast(STUDIO.data, small, window), camera.cast(STUDIO.data, small, whole(small))
    inside = np.s_[window.top + 1 : window.bottom - 1, window.left + 1 : window.right - 1]
    difference = part[inside].astype(float) - all_of_it[inside]
    assert np.abs(difference).max() < 40 and np.abs(difference).mean() < 6
    outside = part.copy()
    outside[window.top : window.bottom, window.left : window.right] = 0
    assert not outside.any() and all_of_it.min() >= 1


def test_pixel_rays_pass_through_the_pixels_they_are_named_for() -> None:
    rays = pixel_rays(CAMERA, whole(CAMERA)).reshape(720, 1280, 3)
    for row, column in ((0, 0), (719, 1279), (100, 900)):
        x, y, z = rays[row, column]
        assert np.allclose(
            [x / z * 800 + 640, y / z * 800 + 360, np.linalg.norm(rays[row, column])], [column + 0.5, row + 0.5, 1.0]
        )
