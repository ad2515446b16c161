"""Laws of where a held box is shown, handed over and opened."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from preshape.hal.transform import Matrix
from preshape.hal.world import FACES, Face, face_normal
from preshape.planner.air_pose import AirPlace, air_pose, open_places, upper_face

PAIRS: list[tuple[Face, Face]] = [(a, b) for a, b in product(FACES, FACES) if a[1] != b[1]]


def looks(X: Matrix, face: Face) -> Matrix:
    return X[:3, :3] @ face_normal(face)


@pytest.mark.parametrize(("end", "face"), PAIRS)
def test_the_box_is_turned_as_asked_in_every_place(end: Face, face: Face) -> None:
    for place in (AirPlace(), *open_places()):
        X = air_pose(place, end, face)
        np.testing.assert_allclose(X[:3, :3].T @ X[:3, :3], np.eye(3), atol=1e-12)
        assert np.linalg.det(X[:3, :3]) == pytest.approx(1.0)
        np.testing.assert_array_equal(X[:3, 3], place.center)
        np.testing.assert_allclose(looks(X, end), place.toward_right, atol=1e-12)
        # No direction across the gripped axis looks more along `facing`.
        across = place.facing - (place.facing @ place.toward_right) * place.toward_right
        assert looks(X, face) @ place.facing == pytest.approx(np.linalg.norm(across))


@pytest.mark.parametrize(("end", "face"), [("+z", "-z"), ("+z", "+z"), ("-x", "+x")])
def test_parallel_faces_are_refused_by_name(end: Face, face: Face) -> None:
    with pytest.raises(ValueError, match="facing_face: got .* perpendicular to"):
        air_pose(AirPlace(), end, face)


def test_places_to_open_are_before_the_robot_with_the_opening_to_it_and_all_different() -> None:
    places = open_places()
    rows = {tuple(np.round([*p.center, *p.facing, *p.toward_right], 9)) for p in places}
    assert len(rows) == len(places) > 0
    for place in places:
        assert place.center[0] > 0.3 and place.center[2] > 0.3
        assert np.linalg.norm(place.facing) == pytest.approx(1.0)
        assert np.linalg.norm(place.toward_right) == pytest.approx(1.0)
        assert place.facing @ place.toward_right == pytest.approx(0.0, abs=1e-12)
        assert place.facing[2] > 0.0


@pytest.mark.parametrize("seed", range(20))
def test_upper_face_is_the_one_that_looks_up_the_most(seed: int) -> None:
    R = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    X = np.eye(4)
    X[:3, :3] = R * np.sign(np.linalg.det(R))
    highest = max(looks(X, face)[2] for face in FACES)
    assert looks(X, upper_face(X, FACES))[2] == highest
