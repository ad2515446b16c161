"""Laws of what the table tells of an object that rests on it."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.resting import rested
from preshape.hal.transform import Matrix, exp_so3, log_so3, transform
from preshape.hal.world import FACES, Face, face_normal
from preshape.planner.air_pose import upper_face

SIZE = np.array([0.15, 0.08, 0.20])


def resting(up: Face, yaw: float) -> Matrix:
    n = face_normal(up)
    side = np.eye(3)[(int(np.argmax(np.abs(n))) + 1) % 3]
    R = exp_so3([0.0, 0.0, yaw]) @ np.vstack([side, np.cross(n, side), n])
    return transform((0.5, -0.3, float(np.abs(n) @ SIZE) / 2), R)


@pytest.mark.parametrize("up", FACES)
@pytest.mark.parametrize("seed", range(4))
def test_a_tilted_estimate_comes_to_lie_flat_by_the_least_turn(up: Face, seed: int) -> None:
    rng = np.random.default_rng(seed)
    X = resting(up, rng.uniform(-3, 3))
    tilt = rng.normal(size=3) * [1.0, 1.0, 0.0]
    tilt *= 0.08 / np.linalg.norm(tilt)
    seen = X.copy()
    seen[:3, :3] = exp_so3(tilt) @ X[:3, :3]
    seen[:3, 3] += [0.003, -0.002, 0.004]
    found = rested(seen, SIZE)
    assert upper_face(found, FACES) == up
    np.testing.assert_allclose(found[:3, :3] @ face_normal(up), [0.0, 0.0, 1.0], atol=1e-12)
    assert found[2, 3] == pytest.approx(X[2, 3]) and np.allclose(found[:2, 3], seen[:2, 3])
    assert np.linalg.norm(log_so3(found[:3, :3] @ seen[:3, :3].T)) == pytest.approx(0.08, abs=1e-9)
    np.testing.assert_allclose(found[:3, :3], X[:3, :3], atol=1e-9)


@pytest.mark.parametrize("up", FACES)
def test_what_rests_already_stays_and_a_higher_table_raises_it(up: Face) -> None:
    X = resting(up, 0.7)
    np.testing.assert_allclose(rested(X, SIZE), X, atol=1e-12)
    assert rested(X, SIZE, 0.1)[2, 3] == pytest.approx(X[2, 3] + 0.1)
